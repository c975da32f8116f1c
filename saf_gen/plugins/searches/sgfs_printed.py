"""Spike-based golden fast search as printed: kept for the record (Su et al., CVPR 2024), it does not find the focus."""

from dataclasses import dataclass
from typing import ClassVar

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._golden_narrowing import RATIO, THRESHOLD, check_golden_options, narrow_to_centre
from saf_gen.plugins.searches._windows import check_frame_count, check_windows_fit


@dataclass(frozen=True)
class GoldenFastSearchPrinted:
    """Golden fast search exactly as Algorithm 1 of Su et al. prints it; it is expected to fail.

    Each round adds ``control_period`` frames to the T frames so far and compares the windows of αT frames at their two
    ends, with α = ``ratio``. The sweep stops if the earlier window scores less than the later one. On a sweep towards
    the focus, the later window scores more from the beginning, so the sweep stops in the first control period. With
    ``turned``, the sign is reversed: the sweep stops once the earlier window scores more, which is at T = 2p for a
    curve symmetric about the focus p. A golden search (``egs``) then runs on the last αT/2 frames, 1.38p ... 2p, which
    do not contain the focus. The search abstains if the sweep ends first. It takes two scores per round and two per
    golden step. The trace holds the centres of the golden search, in frames from 0.

    References
    ----------
    Algorithm 1 of Su et al., "Intensity-Robust Autofocus for Spike Camera", CVPR 2024,
    doi:10.1109/CVPR52733.2024.02363; its released code differs, see ``sgfs_code``.
    """

    control_period: int = 100
    threshold: float = THRESHOLD
    ratio: float = RATIO
    turned: bool = False

    causal: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_frame_count("control_period", self.control_period)
        check_golden_options(self.threshold, self.ratio)
        if not isinstance(self.turned, bool):
            raise BadInput(f"turned is {self.turned!r}", allowed="true, false")

    def __call__(self, view: View) -> Answer:
        """Return the answer for a sweep; raise BadInput if it is shorter than a control period."""
        check_windows_fit(view, "control_period", frames=self.control_period)
        for so_far in range(self.control_period, view.frames + 1, self.control_period):
            window = max(round(self.ratio * so_far), 1)
            earlier, later = view.score(0, window), view.score(so_far - window, so_far)
            if (earlier > later) if self.turned else (earlier < later):
                begin = so_far - max(round(self.ratio * so_far / 2), 1)
                trace = narrow_to_centre(view, begin, stop=so_far, threshold=self.threshold, ratio=self.ratio)
                return Answer(trace[-1], trace, f"stopped after {so_far} of {view.frames} frames")
        return Answer(None, (), "the sweep ended before the algorithm stopped")
