"""Golden fast search that stops while the sweep goes on."""

import math
from dataclasses import dataclass
from typing import ClassVar

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.searches._golden_narrowing import (
    RATIO,
    check_frame_count,
    half_score_difference,
    narrow_to_centre,
)


@dataclass(frozen=True)
class GoldenFastSearchCausal:
    """Spike-based golden fast search with a stop that needs no future: ``falls`` blocks running with less s.

    s is that of ``sgfs_code``, whose stop is the largest s of the whole sweep; here the sweep ends once s has
    fallen for ``falls`` blocks in a row, a little later, or at its end. A golden search (``egs``) then runs
    on the last 0.618 of the frames so far. The first s is taken after a quarter of the sweep, so it cannot
    answer before 0.0955 + 0.382·falls/blocks of it. Noise and steps of the light can make s fall so often
    before the focus; more ``falls`` make that rarer. Two scores a block, two a step. The trace is that of the
    golden search, centres, frames from 0.
    """

    dt: int = 100
    falls: int = 3

    causal: ClassVar[bool] = True
    source: ClassVar[str] = (
        "ours, after the released code of Su et al., Intensity-Robust Autofocus for Spike Camera, CVPR 2024, "
        "doi:10.1109/CVPR52733.2024.02363"
    )

    def __post_init__(self) -> None:
        check_frame_count(self.dt, "dt")
        check_frame_count(self.falls, "falls")

    def __call__(self, view: View) -> Answer:
        """Search until s falls.

        Raises BadInput where the recording holds no block, or too few frames in its first quarter to cut in
        two.
        """
        blocks = view.frames // self.dt
        first = max(math.ceil(blocks / 4), 1)
        if blocks < 1 or first * self.dt < 3:
            raise BadInput(
                f"a recording of {view.frames} frames is too short for blocks of {self.dt} frames",
                allowed="at least one block, and three frames in the first quarter",
                hint="choose another dt",
            )
        stop = self._stop(view, first, blocks)
        begin = math.floor((1 - RATIO) * stop)
        trace = narrow_to_centre(view, begin, stop=stop)
        return Answer(trace[-1], trace, f"stopped after {stop} of {view.frames} frames")

    def _stop(self, view: View, first: int, blocks: int) -> int:
        """Frames that have passed when s has fallen often enough, or when there are no more blocks."""
        before, fallen = math.inf, -1  # the first s is below what never was; that is no fall
        for k in range(first, blocks + 1):
            now = half_score_difference(view, k * self.dt)
            fallen = fallen + 1 if now < before else 0
            if fallen == self.falls:
                return k * self.dt
            before = now
        return blocks * self.dt
