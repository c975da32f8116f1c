"""Sum of Sobel gradient magnitudes, the baseline in the released code of Su et al."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from saf_gen.plugins.measures._counts import as_integers


@dataclass(frozen=True)
class GradientMagnitude:
    """Σ√(Gx² + Gy²) over all pixels, with 3×3 Sobel kernels (smoothing 1-2-1 not normalised) and replicated borders.

    The magnitudes of noise add up, so pictures with few counts score high. The score never rises when a periodic scene
    is blurred further.

    Range from 0, in counts; degree 1; cost 17: twelve additions, four multiplications and a root per pixel.

    References
    ----------
    Released code of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363.
    """

    degree: ClassVar[int] = 1
    cost: ClassVar[float] = 17.0
    score_range: ClassVar[str] = "from 0"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type."""
        return _magnitudes(as_integers(counts).astype(np.float64))


@njit(nogil=True, cache=True)
def _magnitudes(c: np.ndarray) -> float:
    """Return the score of float64 counts.

    The loop is compiled because temporary arrays for each step would cost more than the arithmetic.
    """
    rows, cols = c.shape
    total = 0.0
    for i in range(rows):
        up, here, down = c[max(i - 1, 0)], c[i], c[min(i + 1, rows - 1)]
        row_sum = 0.0
        for j in range(cols):
            left, right = max(j - 1, 0), min(j + 1, cols - 1)
            gx = up[right] - up[left] + 2.0 * (here[right] - here[left]) + down[right] - down[left]
            gy = down[left] - up[left] + 2.0 * (down[j] - up[j]) + down[right] - up[right]
            row_sum += math.sqrt(gx * gx + gy * gy)
        total += row_sum
    return total
