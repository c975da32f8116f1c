"""Ratio of wavelet energies: that of the details, divided by that of the smooth remainder."""

from dataclasses import dataclass
from math import sqrt
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_floats
from saf_gen.plugins.measures._filters import correlate_separable
from saf_gen.plugins.measures._moments import mean_square
from saf_gen.plugins.measures._options import check_whole_number

A, B = sqrt(10), sqrt(5 + 2 * sqrt(10))
LOW = np.array([1 + A + B, 5 + A + 3 * B, 10 - 2 * A + 2 * B, 10 - 2 * A - 2 * B, 5 + A - 3 * B, 1 + A - B])
LOW /= 16 * sqrt(2)
HIGH = LOW[::-1] * [1, -1, 1, -1, 1, -1]
"""Daubechies' orthonormal wavelet with six taps and three vanishing moments."""


@dataclass(frozen=True)
class WaveletRatio:
    """Energy of the details of ``levels`` octaves divided by the energy of the remainder, with Daubechies' D6 wavelet.

    Energies are means per pixel over the coefficients whose six taps fit into the image. Second-order surfaces have no
    details. The smooth remainder contains the brightness. One level covers the finest octave, which is mostly noise if
    counts are low. The score is 0.0 if the filter does not fit at every level, or if the remainder is 0.

    Range from 0; degree 0; cost 38: two passes of six taps for each of four bands, at a half and a quarter of
    the pixels; many levels cost up to a third more.

    References
    ----------
    .. [1] Kautsky et al., Pattern Recognition Letters 23(14), 2002, doi:10.1016/S0167-8655(02)00152-6.
    .. [2] Xie, Rong and Sun, IROS 2006, doi:10.1109/IROS.2006.282641.
    .. [3] D6: Yang and Nelson, "Wavelet-based autofocusing and unsupervised segmentation", IROS 2003.
    """

    levels: int = 1

    degree: ClassVar[int] = 0
    score_range: ClassVar[str] = "from 0; 0 for constant counts and ramps"

    def __post_init__(self) -> None:
        check_whole_number("levels", self.levels, highest=8)

    @property
    def cost(self) -> float:
        """Additions and multiplications per pixel."""
        octave = 4 * LOW.size * (1 + 1 / 2) + 3 / 2  # four bands, sums of columns at every other row
        left = 4.0**-self.levels
        return octave * (1 - left) * 4 / 3 + 2 * left

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type."""
        remainder, details = as_floats(counts), 0.0
        for level in range(1, self.levels + 1):
            if min(remainder.shape) < LOW.size:
                return 0.0
            bands = ((LOW, HIGH), (HIGH, LOW), (HIGH, HIGH))
            details += sum(mean_square(correlate_separable(remainder, *band, 2)) for band in bands) / 4**level
            remainder = correlate_separable(remainder, LOW, LOW, 2)
        energy = mean_square(remainder) / 4**self.levels
        return details / energy if energy else 0.0
