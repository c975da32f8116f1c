"""Golden fast search, as the released code of Su et al. runs it."""

import math
from dataclasses import dataclass
from typing import ClassVar

from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._golden_narrowing import (
    RATIO,
    count_search_blocks,
    golden_search_feedback,
    narrow_golden_interval_as_released,
)
from saf_gen.plugins.searches._windows import check_search_frame_count


@dataclass(frozen=True)
class GoldenFastSearchCode:
    """Spike-based golden fast search: finds where a sweep could have stopped, then searches back from there.

    After each block of ``dt`` frames from a quarter of the sweep on, the score of the later half of the
    frames so far is compared with that of the earlier half: s = score(h−1 ... E) − score(1 ... h−1). The
    sweep stops at the largest s, which is known only at its end, so the search is not causal. The golden
    search then runs on the last 0.618 of the frames before the stop. It cannot answer in the first 9.55 % of
    a sweep. Two scores per block, two per step. The trace is that of the golden search, 1-based frames.

    References
    ----------
    Released code of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363; its printed Algorithm 1 differs.
    """

    dt: int = 100

    causal: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_search_frame_count("dt", self.dt)

    def __call__(self, view: View) -> Answer:
        """Search the whole recording. Raise BadInput where it is too short for blocks of ``dt`` frames."""
        first, blocks = count_search_blocks(view, self.dt)
        differences = [golden_search_feedback(view, k * self.dt) if k >= first else 0.0 for k in range(1, blocks + 1)]
        earliest = max(blocks // 4, 1)
        # Where blocks do not divide by four, the earliest stop has no s but the 0 that the code begins with.
        stop = max(range(earliest, blocks + 1), key=lambda k: differences[k - 1])
        right = stop * self.dt
        left = math.floor(right - RATIO * (right - 1))
        trace = narrow_golden_interval_as_released(view, left, right=right)
        return Answer(float(trace[-1] - 1), trace, f"stopped after {right} of {view.frames} frames")
