"""Golden search on a recording, as the released code of Su et al. runs it."""

from dataclasses import dataclass
from typing import ClassVar

from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._golden_narrowing import (
    RATIO,
    THRESHOLD,
    check_golden_search_options,
    check_search_recording_length,
    narrow_golden_interval_as_released,
)


@dataclass(frozen=True)
class GoldenSearchCode:
    """Event-based golden search, applied to spikes: narrows a whole recording.

    Two overlapping windows, each ``ratio`` of the interval that is left, are scored, and the better one is
    kept, until no more than ``threshold`` frames are left. The first steps average over the light of most of
    the sweep. Two scores per step, 16 steps for 20,000 frames. The trace holds the middle of the interval,
    1-based frames, before the first step and after each.

    References
    ----------
    .. [1] Lin et al., "Autofocus for Event Cameras", CVPR 2022, doi:10.1109/CVPR52688.2022.01586.
    .. [2] Released code of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363.
    """

    threshold: float = THRESHOLD
    ratio: float = RATIO

    causal: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_golden_search_options(self.threshold, self.ratio)

    def __call__(self, view: View) -> Answer:
        """Search the whole recording. Raise BadInput where its interval is no wider than the threshold."""
        check_search_recording_length(view, self.threshold, longest_refused=self.threshold + 1)
        trace = narrow_golden_interval_as_released(
            view, 1, right=view.frames, threshold=self.threshold, ratio=self.ratio
        )
        return Answer(float(trace[-1] - 1), trace)
