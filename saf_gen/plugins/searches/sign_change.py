"""Stop where the growth of a score changes sign: from plus to minus, during a sweep."""

from collections import deque
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._windows import check_frame_count, check_numbers, check_windows_fit

FEWEST = 8
"""Growths that are needed before a change of sign, to estimate their scatter."""


@dataclass(frozen=True)
class SignChange:
    """Follows a sweep block by block, and stops once the score has turned from growing to falling.

    With ``tenengrad`` this is ELP, −Σ ∇²I·E of an intensity image I and a frame of events E, which is above 0 on the
    way to the focus and below 0 after it. Product and sign are used as published. A spike camera has no events: E is
    the counts of the later half of a block minus those of the earlier half, and I is their sum. For the Laplacian −GᵀG
    of a gradient G, the product is then exactly the growth of the squared gradient from one half to the other.
    Therefore, the search uses the growth of any score. Counting noise, which is in both halves, cancels on average, and
    ``tenengrad_n`` also tolerates a change of the light.

    As published, small fluctuations are smoothed and jumps are kept: a growth that differs from the mean of the
    ``past`` growths before it by less than ``near`` of the largest magnitude so far is replaced by the mean that
    includes it. The published window, threshold and factor were not available; the values here were not tuned. Far from
    the focus the sign is noise. A change therefore counts only if, since it last fell, the score had grown by ``above``
    times the median absolute difference of neighbouring growths, and only after at least 8 blocks. This condition was
    added in this project; with it, 2 % of sweeps of 40 blocks of noise stop.

    The answer is the frame where the line between the last growth above 0 and the first one below 0 crosses 0. The
    search abstains if the sweep has no such change. It takes two scores per block. The trace holds the centres of both
    blocks, in frames from 0.

    References
    ----------
    Bao, Gao, Li and Wang, "One-Step Event-Driven High-Speed Autofocus", CVPR 2025, arXiv:2503.01214.
    """

    window: int = 100
    past: int = 5
    near: float = 0.1
    above: float = 10.0

    causal: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_frame_count("window", self.window)
        if self.window < 2:
            raise BadInput(f"window is {self.window!r}", allowed="at least 2 frames, which have two halves")
        check_frame_count("past", self.past)
        check_numbers(self, {"near": 1, "above": 1e6})

    def __call__(self, view: View) -> Answer:
        """Return the answer for a sweep; raise BadInput if it is shorter than one block."""
        check_windows_fit(view, "window", frames=self.window)
        before: deque[float] = deque(maxlen=self.past)
        growths: list[float] = []
        last_above: tuple[float, float] | None = None
        rise = 0.0
        for first in range(0, view.frames - self.window + 1, self.window):
            middle, stop = first + self.window // 2, first + self.window
            earlier = view.score(first, middle)
            growth = self._smooth(view.score(middle, stop) - earlier, before=before, growths=growths)
            centre = first + (self.window - 1) / 2
            if growth > 0:
                last_above, rise = (centre, growth), rise + growth
            elif growth < 0 and last_above is not None:
                if len(growths) >= FEWEST and rise >= self.above * float(np.median(np.abs(np.diff(growths)))):
                    frame = last_above[0] + (centre - last_above[0]) * last_above[1] / (last_above[1] - growth)
                    return Answer(frame, (last_above[0], centre), f"stopped after {stop} of {view.frames} frames")
                last_above, rise = None, 0.0
            growths.append(growth)
        return Answer(None, (), "no change from growing to falling that stands out")

    def _smooth(self, raw: float, *, before: deque[float], growths: list[float]) -> float:
        """Return the growth ``raw``, smoothed if it is similar to those in ``before``; append ``raw`` to ``before``."""
        largest = max(map(abs, [raw, *growths]))
        is_like = before and abs(raw - float(np.mean(before))) < self.near * largest
        smooth = float(np.mean([*before, raw])) if is_like else raw
        before.append(raw)
        return smooth
