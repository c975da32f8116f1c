"""Golden search on a recording, as the paper's released code runs it."""

from dataclasses import dataclass
from typing import ClassVar

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.searches._golden_narrowing import RATIO, THRESHOLD, check_narrowing, narrow_as_released


@dataclass(frozen=True)
class GoldenSearchCode:
    """Event-based golden search, carried over to spikes: narrows down a whole recording.

    Two overlapping windows, each ``ratio`` of what is left, are scored; the better one is kept, until no
    more than ``threshold`` frames are left. The windows shrink with the interval, so the first steps weigh
    the light of most of the sweep. Two scores a step, 16 steps for 20,000 frames.
    The trace holds the middle of the interval, 1-based frames, before the first step and after each.
    """

    threshold: float = THRESHOLD
    ratio: float = RATIO

    causal: ClassVar[bool] = False
    source: ClassVar[str] = (
        "Lin et al., Autofocus for Event Cameras, CVPR 2022, doi:10.1109/CVPR52688.2022.01586; released "
        "code of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363"
    )

    def __post_init__(self) -> None:
        check_narrowing(self.threshold, self.ratio)

    def __call__(self, view: View) -> Answer:
        """Search the whole recording.

        Raises BadInput where it is no longer than the threshold: no window would be scored, and the answer
        would be its middle whatever is in it.
        """
        if view.frames - 1 <= self.threshold:
            raise BadInput(
                f"a recording of {view.frames} frames is too short for threshold {self.threshold:g}",
                allowed=f"more than {self.threshold + 1:g} frames",
                hint="choose a smaller threshold",
            )
        trace = narrow_as_released(view, 1, right=view.frames, threshold=self.threshold, ratio=self.ratio)
        return Answer(float(trace[-1] - 1), trace)
