"""Spike-based golden fast search as released: the code of Su et al. runs it so."""

import math
from dataclasses import dataclass
from typing import ClassVar

from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._golden_narrowing import RATIO, count_blocks, golden_feedback, narrow_as_released
from saf_gen.plugins.searches._windows import check_frame_count


@dataclass(frozen=True)
class GoldenFastSearchCode:
    """Spike-based golden fast search: finds where a sweep could have stopped, then searches back from there.

    After each block of ``dt`` frames, from a quarter of the sweep on, the score of the later half of the E frames so
    far is compared with that of the earlier half: s = score(h−1 ... E) − score(1 ... h−1), with h = ⌊(E + 1)/2⌋. The
    sweep stops at the largest s, which is known only at its end, so the search is not causal. A golden search then runs
    on the last 0.618 of the frames before the stop. The answer cannot be in the first 9.55 % of a sweep. The search
    takes two scores per block and two per golden step. The trace holds the midpoints of the golden search, in frames
    from 1.

    References
    ----------
    Released code of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363. Algorithm 1 in the paper differs from it.
    """

    dt: int = 100

    causal: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_frame_count("dt", self.dt)

    def __call__(self, view: View) -> Answer:
        """Return the answer for a recording; raise BadInput if it is too short for blocks of ``dt`` frames."""
        first, blocks = count_blocks(view, self.dt)
        differences = [golden_feedback(view, k * self.dt) if k >= first else 0.0 for k in range(1, blocks + 1)]
        earliest = max(blocks // 4, 1)
        # If blocks are not a multiple of four, the earliest stop has no s, only the initial 0 of the released code.
        stop = max(range(earliest, blocks + 1), key=lambda k: differences[k - 1])
        right = stop * self.dt
        left = math.floor(right - RATIO * (right - 1))
        trace = narrow_as_released(view, left, right=right)
        return Answer(float(trace[-1] - 1), trace, f"stopped after {right} of {view.frames} frames")
