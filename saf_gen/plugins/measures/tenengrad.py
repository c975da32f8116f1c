"""Energy of the Sobel gradient: the measure called Tenengrad."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers
from saf_gen.plugins.measures._moments import sum_of_squares


@dataclass(frozen=True)
class Tenengrad:
    """Mean of Gx² + Gy² of the 3×3 Sobel gradient over the pixels where the kernel fits, without a threshold.

    The kernel's smoothing 1-2-1 is not normalised, so a ramp of s counts per pixel scores 64s². White noise adds 24
    times its variance. The score is 0.0 for fewer than three rows or columns, and never rises when a periodic scene is
    blurred further.

    Range from 0, in squared counts; degree 2; cost 12: eight additions and four multiplications per pixel.

    References
    ----------
    .. [1] Krotkov, "Focusing", International J. Computer Vision 1(3), 1988, doi:10.1007/BF00127822.
    .. [2] TENG in Pertuz et al., Pattern Recognition 46(5), 2013, doi:10.1016/j.patcog.2012.11.011.
    """

    degree: ClassVar[int] = 2
    cost: ClassVar[float] = 12.0
    score_range: ClassVar[str] = "from 0; 0 for constant counts"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type, in squared counts."""
        c = as_integers(counts)
        if min(c.shape) < 3:
            return 0.0
        smooth, slope = c[:-2] + 2 * c[1:-1] + c[2:], c[2:] - c[:-2]
        gx = smooth[:, 2:] - smooth[:, :-2]
        gy = slope[:, :-2] + 2 * slope[:, 1:-1] + slope[:, 2:]
        return (sum_of_squares(gx) + sum_of_squares(gy)) / gx.size
