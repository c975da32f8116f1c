"""The valley between the two highest peaks of a curve."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._numbers import check_search_numbers
from saf_gen.plugins.searches._windows import check_search_frame_count, check_search_windows_fit, score_search_windows


@dataclass(frozen=True)
class Valley:
    """Answers with the lowest block between the two highest peaks of the smoothed curve.

    The search of ESVA, for a rate of events (``change_rate``) that is largest before and after the focus. As published:
    a Gaussian of ``smooth`` samples; samples that jump by more than ``jump`` of the larger neighbour move by the
    fraction ``weight`` to the mean of both; then the highest peak, and the highest other one that is far enough.

    Not stated, and set here: peaks are ``apart`` of the curve from each other and ``stand_out`` of its range high. That
    the second peak must not be "too close in amplitude", without a number, is left out. The published samples are
    1 ms; the ``window`` is that of the other searches, because half windows of 1 ms count hardly a spike.

    A curve without two peaks is no answer. One score per block. The trace holds the centres of the peaks.

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
        check_search_frame_count("window", self.window)
        check_search_numbers(self, {"smooth": 1e3, "jump": 1e6, "weight": 1, "apart": 1, "stand_out": 1})

    def __call__(self, view: View) -> Answer:
        """Search the whole recording. Raise BadInput where it is shorter than one block."""
        check_search_windows_fit(view, "window", frames=self.window)
        firsts, scores = score_search_windows(view, self.window, step=self.window)
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
        """Return the smoothed curve, its jumps drawn to their neighbours."""
        smooth = gaussian_filter1d(scores, self.smooth, mode="nearest") if self.smooth > 0 else scores
        if len(smooth) < 3:
            return smooth
        before, here, after = smooth[:-2], smooth[1:-1], smooth[2:]
        jumps = np.abs(here - before) > self.jump * np.maximum(before, after)
        mended = (1 - self.weight) * here + self.weight * (before + after) / 2
        return np.concatenate([smooth[:1], np.where(jumps, mended, here), smooth[-1:]])
