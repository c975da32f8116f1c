"""Power in a ring of spatial frequencies, between the scene's shading and the noise."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._spectrum import FFT_COST, check_band, power_in_band


@dataclass(frozen=True)
class MidBandPower:
    """Variance in the spatial frequencies from ``lowest`` to ``highest`` cycles per pixel, Σ |FFT(c − ū)|²/N².

    Over all frequencies this is the variance. High frequencies are mostly noise, and low ones change little with focus;
    contrast reversals of a lens limit the band from below. The default band, periods of 4 to 8 pixels, was not tuned;
    in it, shot noise adds 15 % of its variance. The border is not tapered. The score never rises when a periodic scene
    is blurred further.

    Range 0 to the variance, in squared counts; degree 2; cost 45 for 400 x 250 pixels: a real Fourier
    transform, 2.5 log2 N operations per pixel, plus three operations per pixel.

    References
    ----------
    .. [1] Oliva, Bravo-Zanoguera and Price, Applied Optics 38(4), 1999, doi:10.1364/AO.38.000638.
    .. [2] Firestone et al., Cytometry 12(3), 1991, doi:10.1002/cyto.990120302.
    """

    lowest: float = 0.125
    highest: float = 0.25

    degree: ClassVar[int] = 2
    cost: ClassVar[float] = FFT_COST + 3
    score_range: ClassVar[str] = "0 ... the variance of the counts"

    def __post_init__(self) -> None:
        check_band(self.lowest, self.highest)

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type, in squared counts."""
        return float(power_in_band(counts, self.lowest, highest=self.highest)[0].sum())
