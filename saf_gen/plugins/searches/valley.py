"""Valley between the two highest peaks of a curve."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._windows import check_frame_count, check_numbers, check_windows_fit, score_windows


@dataclass(frozen=True)
class Valley:
    """Answers with the lowest block between the two highest peaks of the smoothed curve.

    This is the search of ESVA, for a rate of events (``change_rate``) that is largest before and after the focus. As
    published, the curve is smoothed by a Gaussian of ``smooth`` samples. Then samples that differ from the one before
    by more than ``jump`` times the larger of their neighbours move by the fraction ``weight`` towards the mean of both
    neighbours. The search finds the highest peak, and the highest other peak that is far enough from it.

    The paper does not state two values that are set here: peaks are at least the fraction ``apart`` of the curve's
    length from each other, and their prominence is at least the fraction ``stand_out`` of its range. The paper also
    demands, without a number, that the second peak not be "too close in amplitude", which is left out. Published
    samples are 1 ms long; ``window`` has the same default as in the other searches instead, because half windows of
    1 ms count very few spikes.

    The search abstains if the curve has fewer than two peaks. It takes one score per block. The trace holds the centres
    of the peaks.

    References
    ----------
    Xiang, Zhu, Zhang and Tian, "Event Structural Valley: A Unified Theoretical and Practical Framework for Event Camera
    Autofocus", CVPR 2026.
    """

    window: int = 100
    smooth: float = 3.0
    jump: float = 0.3
    weight: float = 0.6
    apart: float = 0.05
    stand_out: float = 0.05

    causal: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_frame_count("window", self.window)
        check_numbers(self, {"smooth": 1e3, "jump": 1e6, "weight": 1, "apart": 1, "stand_out": 1})

    def __call__(self, view: View) -> Answer:
        """Return the answer for a recording; raise BadInput if it is shorter than one block."""
        check_windows_fit(view, "window", frames=self.window)
        firsts, scores = score_windows(view, self.window, step=self.window)
        curve = self._regularise(np.array(scores))
        least = {"distance": max(1, self.apart * len(curve)), "prominence": self.stand_out * float(np.ptp(curve))}
        peaks, _ = find_peaks(curve, **least)
        if len(peaks) < 2:
            return Answer(None, (), f"{len(peaks)} of two peaks")
        left, right = sorted(peaks[np.argsort(-curve[peaks], kind="stable")[:2]].tolist())
        lowest = left + int(np.argmin(curve[left : right + 1]))
        left, lowest, right = (float(firsts[block]) + (self.window - 1) / 2 for block in (left, lowest, right))
        return Answer(lowest, (left, right))

    def _regularise(self, scores: np.ndarray) -> np.ndarray:
        """Return the smoothed curve, with samples that jump moved towards their neighbours."""
        smooth = gaussian_filter1d(scores, self.smooth, mode="nearest") if self.smooth > 0 else scores
        if len(smooth) < 3:
            return smooth
        before, here, after = smooth[:-2], smooth[1:-1], smooth[2:]
        jumps = np.abs(here - before) > self.jump * np.maximum(before, after)
        mended = (1 - self.weight) * here + self.weight * (before + after) / 2
        return np.concatenate([smooth[:1], np.where(jumps, mended, here), smooth[-1:]])
