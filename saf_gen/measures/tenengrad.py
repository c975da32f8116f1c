"""Tenengrad: energy of the Sobel gradient."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.measures._counts import as_numbers
from saf_gen.measures._moments import sum_of_squares


@dataclass(frozen=True)
class Tenengrad:
    """Mean of Gx² + Gy², 3x3 Sobel with 1-2-1 not normalised, where it lies inside; no threshold.

    A ramp of s counts a pixel scores 64s². Noise adds its energy, 24 times the variance of white noise, where
    ``gradient_code`` adds its magnitude. 0.0 for fewer than three rows or columns.

    Never rises when a periodic scene is blurred further. Squared counts, range from 0, degree 2, cost 12:
    eight additions and four multiplications a pixel.
    """

    degree: ClassVar[int] = 2
    cost: ClassVar[float] = 12.0
    source: ClassVar[str] = (
        "Krotkov, Focusing, IJCV 1, 1988, doi:10.1007/BF00127822; TENG of Pertuz et al., Pattern "
        "Recognition 46(5), 2013, doi:10.1016/j.patcog.2012.11.011"
    )
    score_range: ClassVar[str] = "from 0; 0 for constant counts"

    def __call__(self, counts: np.ndarray) -> float:
        """Score of counts (row, col), any number type, squared counts."""
        c = as_numbers(counts)
        if min(c.shape) < 3:
            return 0.0
        smooth, slope = c[:-2] + 2 * c[1:-1] + c[2:], c[2:] - c[:-2]
        gx = smooth[:, 2:] - smooth[:, :-2]
        gy = slope[:, :-2] + 2 * slope[:, 1:-1] + slope[:, 2:]
        return (sum_of_squares(gx) + sum_of_squares(gy)) / gx.size
