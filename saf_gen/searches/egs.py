"""Golden search on a recording, without the conventions of the released code."""

from dataclasses import dataclass
from typing import ClassVar

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.searches._golden_narrowing import RATIO, THRESHOLD, check_narrowing, narrow_to_centre


@dataclass(frozen=True)
class GoldenSearch:
    """Event-based golden search on spikes: narrows down a whole recording to ``threshold`` frames.

    As ``egs_code``, but for what that code brings along: frames are whole and counted from 0, the answer is
    the centre of the frames that are left, and equal scores keep the middle rather than the later window. The
    windows shrink with the interval, so the first steps weigh the light of most of the sweep.
    Two scores a step, 16 steps for 20,000 frames. The trace holds the centre before the first step and after
    each, frames from 0.
    """

    threshold: float = THRESHOLD
    ratio: float = RATIO

    causal: ClassVar[bool] = False
    source: ClassVar[str] = (
        "Lin et al., Autofocus for Event Cameras, CVPR 2022, doi:10.1109/CVPR52688.2022.01586"
    )

    def __post_init__(self) -> None:
        check_narrowing(self.threshold, self.ratio)

    def __call__(self, view: View) -> Answer:
        """Search the whole recording.

        Raises BadInput where it is no longer than the threshold: no window would be scored, and the answer
        would be its middle whatever is in it.
        """
        if view.frames <= self.threshold:
            raise BadInput(
                f"a recording of {view.frames} frames is too short for threshold {self.threshold:g}",
                allowed=f"more than {self.threshold:g} frames",
                hint="choose a smaller threshold",
            )
        trace = narrow_to_centre(view, 0, stop=view.frames, threshold=self.threshold, ratio=self.ratio)
        return Answer(trace[-1], trace)
