"""Golden fast search, as the paper's released code runs it."""

import math
from dataclasses import dataclass
from typing import ClassVar

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.searches._golden_narrowing import (
    RATIO,
    check_frame_count,
    half_score_difference,
    narrow_as_released,
)


@dataclass(frozen=True)
class GoldenFastSearchCode:
    """Spike-based golden fast search: finds where a sweep could have stopped, then searches back from there.

    After each block of ``dt`` frames from a quarter of the sweep on, the score of the later half of the
    frames so far is compared with that of the earlier half: s = score(h−1 ... E) − score(1 ... h−1). The
    sweep is said to stop at the largest s, which is only known at its end: not causal. The golden search
    then runs on the last 0.618 of the frames before the stop. It cannot answer in the first 9.55 % of a
    sweep. Two scores a block, two a step. The trace is that of the golden search, 1-based frames.
    """

    dt: int = 100

    causal: ClassVar[bool] = False
    source: ClassVar[str] = (
        "released code of Su et al., Intensity-Robust Autofocus for Spike Camera, CVPR 2024, "
        "doi:10.1109/CVPR52733.2024.02363; its printed Algorithm 1 differs"
    )

    def __post_init__(self) -> None:
        check_frame_count(self.dt, "dt")

    def __call__(self, view: View) -> Answer:
        """Search the whole recording.

        Raises BadInput where it holds no block, or too few frames in its first quarter to cut in two.
        """
        blocks = view.frames // self.dt
        first = max(math.ceil(blocks / 4), 1)
        if blocks < 1 or first * self.dt < 3:
            raise BadInput(
                f"a recording of {view.frames} frames is too short for blocks of {self.dt} frames",
                allowed="at least one block, and three frames in the first quarter",
                hint="choose another dt",
            )
        followed = [
            half_score_difference(view, k * self.dt) if k >= first else 0.0 for k in range(1, blocks + 1)
        ]
        earliest = max(blocks // 4, 1)
        # Where blocks do not divide by four, the earliest stop has no feedback but the 0 it starts with.
        stop = max(range(earliest, blocks + 1), key=lambda k: followed[k - 1])
        right = stop * self.dt
        left = math.floor(right - RATIO * (right - 1))
        trace = narrow_as_released(view, left, right=right)
        return Answer(float(trace[-1] - 1), trace, f"stopped after {right} of {view.frames} frames")
