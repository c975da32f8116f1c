"""Squared gradient that both halves of a window repeat: it contains no counting noise."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from saf_gen.plugins.measures._counts import as_integers


@dataclass(frozen=True)
class SplitGradient:
    """Mean product of the differences of neighbours in the two halves A and B of a window, over squared brightness.

    The score is (mean Δ_y A·Δ_y B + mean Δ_x A·Δ_x B + 4/12)/(ū_A·ū_B), the first octave of ``structure_calibrated``
    without its calibration. Both halves count independently, so counting noise cancels on average except in the spike
    that they share where they meet, which the 4/12 correct. What stays is the picture, and the fixed pattern of the
    sensor. Blur lowers the score of any texture, also of those with a single period, for which measures of structure
    are blind; in light that is changing, the share of dark spikes changes it as well. The score is 0.0 if a half
    has no spike.

    Range: expected value 0 without contrast, otherwise a few times the squared contrast of the finest details; degree 0
    apart from the 4/12; cost 10: two differences, a product and an addition per axis, and two for the means.

    References
    ----------
    This project, after equation 12 of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363.
    """

    halves: ClassVar[bool] = True
    degree: ClassVar[int] = 0
    cost: ClassVar[float] = 10.0
    score_range: ClassVar[str] = "0 expected for no contrast; a few times the squared contrast of the finest details"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (2, row, col) of any number type."""
        halves = as_integers(counts, halves=True)
        if min(halves.shape[1:]) < 2:
            return 0.0
        shared, first, second = shared_gradient(halves)
        size = halves[0].size
        return float((shared + 4 / 12) / (first / size) / (second / size)) if first and second else 0.0


@njit(nogil=True, cache=True)
def shared_gradient(c: np.ndarray) -> tuple[float, float, float]:
    """Return the mean product of vertical differences plus that of horizontal ones, and the sums of both halves.

    ``c`` holds counts (2, row, col). The loop is compiled because temporary arrays would cost more than the arithmetic.
    """
    a, b = c[0], c[1]
    rows, cols = a.shape
    zero = a[0, 0] * 0
    down, across, first, second = zero, zero, zero, zero
    for i in range(rows - 1):
        for j in range(cols):
            down += (a[i + 1, j] - a[i, j]) * (b[i + 1, j] - b[i, j])
    for i in range(rows):
        for j in range(cols - 1):
            across += (a[i, j + 1] - a[i, j]) * (b[i, j + 1] - b[i, j])
        for j in range(cols):
            first += a[i, j]
            second += b[i, j]
    return down / ((rows - 1) * cols) + across / (rows * (cols - 1)), float(first), float(second)
