"""Causal spike-based golden fast search: it decides during the sweep where to stop."""

import math
from dataclasses import dataclass
from typing import ClassVar

from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._golden_narrowing import RATIO, count_blocks, golden_feedback, narrow_to_centre
from saf_gen.plugins.searches._windows import check_frame_count


@dataclass(frozen=True)
class GoldenFastSearchCausal:
    """Spike-based golden fast search that stops once the difference s of two scores has fallen for ``falls`` blocks.

    The difference s is the score of the later half of the frames so far minus that of the earlier half. ``sgfs_code``
    stops at the largest s of the complete sweep; here the sweep stops once s has fallen for ``falls`` blocks in a row,
    or at its end. A golden search (``egs``) then runs on the last 0.618 of the frames so far. The first s is taken
    after a quarter of the sweep, so the answer is never before the fraction 0.0955 + 0.382·falls/blocks of the sweep.
    Noise and steps of the light can make s fall that often before the focus; larger ``falls`` make this rarer. The
    search takes two scores per block and two per golden step. The trace holds the centres of the golden search, in
    frames from 0.

    References
    ----------
    This project, after the released code of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363.
    """

    dt: int = 100
    falls: int = 3

    causal: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_frame_count("dt", self.dt)
        check_frame_count("falls", self.falls)

    def __call__(self, view: View) -> Answer:
        """Return the answer for a sweep; raise BadInput if it is too short for blocks of ``dt`` frames."""
        stop = self._find_stop(view)
        begin = math.floor((1 - RATIO) * stop)
        trace = narrow_to_centre(view, begin, stop=stop)
        return Answer(trace[-1], trace, f"stopped after {stop} of {view.frames} frames")

    def _find_stop(self, view: View) -> int:
        """Return the number of frames after which s has fallen often enough or no blocks are left."""
        first, blocks = count_blocks(view, self.dt)
        before, fallen = math.inf, -1  # the first s has no predecessor, so it is not a fall
        for k in range(first, blocks + 1):
            now = golden_feedback(view, k * self.dt)
            fallen = fallen + 1 if now < before else 0
            if fallen == self.falls:
                return k * self.dt
            before = now
        return blocks * self.dt
