"""Event-based golden search as released: on a recording, as the code of Su et al. runs it."""

from dataclasses import dataclass
from typing import ClassVar

from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._golden_narrowing import (
    RATIO,
    THRESHOLD,
    check_golden_options,
    check_length,
    narrow_as_released,
)


@dataclass(frozen=True)
class GoldenSearchCode:
    """Event-based golden search on spikes, as released: narrows a recording to ``threshold`` frames.

    Each step scores two overlapping windows, each ``ratio`` of the interval that is left, and keeps the better one,
    until no more than ``threshold`` frames are left. The first steps average over the light of most of the sweep. The
    search takes two scores per step, and 16 steps for 20,000 frames. The trace holds the middle of the interval before
    the first step and after each step, in frames from 1.

    References
    ----------
    .. [1] Lin et al., "Autofocus for Event Cameras", CVPR 2022, doi:10.1109/CVPR52688.2022.01586.
    .. [2] Released code of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363.
    """

    threshold: float = THRESHOLD
    ratio: float = RATIO

    causal: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_golden_options(self.threshold, self.ratio)

    def __call__(self, view: View) -> Answer:
        """Return the answer for a recording; raise BadInput if it has at most ``threshold`` + 1 frames."""
        check_length(view, self.threshold, longest_refused=self.threshold + 1)
        trace = narrow_as_released(view, 1, right=view.frames, threshold=self.threshold, ratio=self.ratio)
        return Answer(float(trace[-1] - 1), trace)
