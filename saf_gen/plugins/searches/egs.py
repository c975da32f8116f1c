"""Event-based golden search: on a recording, without the conventions of the code of Su et al. (``egs_code``)."""

from dataclasses import dataclass
from typing import ClassVar

from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._golden_narrowing import (
    RATIO,
    THRESHOLD,
    check_golden_options,
    check_length,
    narrow_to_centre,
)


@dataclass(frozen=True)
class GoldenSearch:
    """Event-based golden search on spikes: narrows a recording to ``threshold`` frames.

    This is ``egs_code`` without the conventions of that code: frames are whole numbers from 0, the answer is the centre
    of the frames that are left, and if two scores are equal, the middle is kept instead of the later window. Windows
    are ``ratio`` of the interval, so the first steps average over the light of most of the sweep. The search takes two
    scores per step, and 16 steps for 20,000 frames. The trace holds the centre before the first step and after each
    step, in frames from 0.

    References
    ----------
    Lin et al., "Autofocus for Event Cameras", CVPR 2022, doi:10.1109/CVPR52688.2022.01586.
    """

    threshold: float = THRESHOLD
    ratio: float = RATIO

    causal: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_golden_options(self.threshold, self.ratio)

    def __call__(self, view: View) -> Answer:
        """Return the answer for a recording; raise BadInput if it is no longer than the threshold."""
        check_length(view, self.threshold, longest_refused=self.threshold)
        trace = narrow_to_centre(view, 0, stop=view.frames, threshold=self.threshold, ratio=self.ratio)
        return Answer(trace[-1], trace)
