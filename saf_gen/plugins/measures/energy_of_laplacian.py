"""Energy of the Laplacian, with the nine-point kernel of weight 20."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers
from saf_gen.plugins.measures._moments import mean_square


@dataclass(frozen=True)
class EnergyOfLaplacian:
    """Mean square of c * L with L = (−1 −4 −1; −4 20 −4; −1 −4 −1), over the pixels where the kernel fits.

    L is −6 times the Laplacian, so c = (ax² + by²)/2 scores 36(a + b)². Ramps score 0, and white noise scores 468 times
    its variance: the highest frequencies weigh most. The score is 0.0 for fewer than three rows or columns, and never
    rises when a periodic scene is blurred further.

    Range from 0, in squared counts; degree 2; cost 10: six additions and four multiplications per pixel.

    References
    ----------
    .. [1] Subbarao, Choi and Nikzad, Optical Engineering 32(11), 1993, doi:10.1117/12.147706.
    .. [2] The kernel is that of Sun, Duthaler and Nelson, "Autofocusing in computer microscopy", Microscopy
       Research and Technique 65(3), 2004, doi:10.1002/jemt.20118.
    """

    degree: ClassVar[int] = 2
    cost: ClassVar[float] = 10.0
    score_range: ClassVar[str] = "from 0; 0 for constant counts and ramps"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type, in squared counts."""
        c = as_integers(counts)
        if min(c.shape) < 3:
            return 0.0
        # L is 36 at the centre minus the outer product of (1 4 1) with itself.
        down = c[:-2] + 4 * c[1:-1] + c[2:]
        return mean_square(36 * c[1:-1, 1:-1] - (down[:, :-2] + 4 * down[:, 1:-1] + down[:, 2:]))
