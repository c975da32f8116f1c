"""Golden fast search as the paper prints it. Kept for the record: it does not find the focus."""

from dataclasses import dataclass
from typing import ClassVar

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.searches._golden_narrowing import (
    RATIO,
    THRESHOLD,
    check_frame_count,
    check_narrowing,
    narrow_to_centre,
)


@dataclass(frozen=True)
class GoldenFastSearchPrinted:
    """Algorithm 1 to the letter, T growing by ``control_period`` frames a round. Expected to fail.

    A round compares the windows of αT frames at the two ends of the T frames so far, and stops where the
    earlier scores less than the later. That is so at once, on every sweep towards the focus: it stops in the
    first control period. With the sign ``turned`` it stops once the earlier scores more, for a curve
    symmetric about the focus at T = 2·p, and goes on to search the last αT/2 frames, 1.38 p ... 2 p: the
    focus p is not among them. Where neither happens before the sweep ends it abstains. Two scores a round,
    two a step. The trace is that of the golden search (``egs``), centres, frames from 0.
    """

    control_period: int = 100
    threshold: float = THRESHOLD
    ratio: float = RATIO
    turned: bool = False

    causal: ClassVar[bool] = True
    source: ClassVar[str] = (
        "Su et al., Intensity-Robust Autofocus for Spike Camera, CVPR 2024, Algorithm 1, "
        "doi:10.1109/CVPR52733.2024.02363; its released code differs, see sgfs_code"
    )

    def __post_init__(self) -> None:
        check_frame_count(self.control_period, "control_period")
        check_narrowing(self.threshold, self.ratio)
        if not isinstance(self.turned, bool):
            raise BadInput(f"turned is {self.turned!r}", allowed="true, false")

    def __call__(self, view: View) -> Answer:
        """Search until the algorithm stops. Raises BadInput where the recording is no control period long."""
        if view.frames < self.control_period:
            raise BadInput(
                f"a recording of {view.frames} frames is shorter than a control period of "
                f"{self.control_period} frames",
                allowed=f"control_period of 1 ... {view.frames}",
                hint="choose a smaller control_period",
            )
        for so_far in range(self.control_period, view.frames + 1, self.control_period):
            window = max(round(self.ratio * so_far), 1)
            earlier, later = view.score(0, window), view.score(so_far - window, so_far)
            if (earlier > later) if self.turned else (earlier < later):
                begin = so_far - max(round(self.ratio * so_far / 2), 1)
                trace = narrow_to_centre(view, begin, stop=so_far, threshold=self.threshold, ratio=self.ratio)
                return Answer(trace[-1], trace, f"stopped after {so_far} of {view.frames} frames")
        return Answer(None, (), "the sweep ended before the algorithm stopped")
