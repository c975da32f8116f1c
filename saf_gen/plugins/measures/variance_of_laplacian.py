"""Variance of the Laplacian, with the five-point kernel."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers
from saf_gen.plugins.measures._moments import variance


@dataclass(frozen=True)
class VarianceOfLaplacian:
    """Variance of c * L with L = (0 −1 0; −1 4 −1; 0 −1 0)/6, over the pixels where the kernel fits.

    The variance is that of the signed response, as in Pertuz et al. Ramps and surfaces of constant curvature score 0,
    and white noise scores 20/36 of its variance. The score is 0.0 for fewer than three rows or columns, and never rises
    when a periodic scene is blurred further.

    Range from 0, in squared counts; degree 2; cost 8: six additions and two multiplications per pixel.

    References
    ----------
    .. [1] Pech-Pacheco et al., ICPR 2000, doi:10.1109/ICPR.2000.903548.
    .. [2] LAPV in Pertuz et al., Pattern Recognition 46(5), 2013, doi:10.1016/j.patcog.2012.11.011.
    """

    degree: ClassVar[int] = 2
    cost: ClassVar[float] = 8.0
    score_range: ClassVar[str] = "from 0; 0 for constant counts and ramps"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type, in squared counts."""
        c = as_integers(counts)
        if min(c.shape) < 3:
            return 0.0
        around = c[:-2, 1:-1] + c[2:, 1:-1] + c[1:-1, :-2] + c[1:-1, 2:]
        return variance(4 * c[1:-1, 1:-1] - around) / 36
