"""Rate of change: the fraction of pixels that would send an event."""

from dataclasses import dataclass
from math import exp, isfinite
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.plugins.measures._counts import as_integers


@dataclass(frozen=True)
class ChangeRate:
    """Fraction of pixels whose log counts differ by ``contrast`` or more between the halves of a window.

    The score replaces the event rate of an event camera, whose pixels send an event when log intensity has changed by
    the contrast threshold. ESVA treats this rate as the area that a change of blur affects: it is largest somewhat
    before and after the focus and has a valley at the focus, which ``change_rate+valley`` searches for. A pixel with
    spikes in only one half counts as changed. Counting noise changes pixels as well: in half windows with few spikes,
    more changes are noise than events. The contrast of 0.2 is common for event cameras and was not tuned. The score is
    0.0 if no pixel counted a spike.

    Range 0 to 1; degree 0; cost 1: a multiplication per pixel, not counting comparisons.

    References
    ----------
    Xiang, Zhu, Zhang and Tian, "Event Structural Valley: A Unified Theoretical and Practical Framework for Event Camera
    Autofocus", CVPR 2026.
    """

    contrast: float = 0.2

    halves: ClassVar[bool] = True
    degree: ClassVar[int] = 0
    cost: ClassVar[float] = 1.0
    score_range: ClassVar[str] = "0 ... 1"

    def __post_init__(self) -> None:
        number = isinstance(self.contrast, int | float) and not isinstance(self.contrast, bool)
        if not (number and isfinite(self.contrast) and 0 < self.contrast <= 10):
            raise BadInput(f"contrast is {self.contrast!r}", allowed="a difference of logarithms, above 0, at most 10")

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (2, row, col) of any number type."""
        first, second = as_integers(counts, halves=True)
        low, high = np.minimum(first, second), np.maximum(first, second)
        return float(np.mean((high >= low * exp(self.contrast)) & (high > 0)))
