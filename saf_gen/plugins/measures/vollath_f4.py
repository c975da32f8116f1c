"""Vollath's F4: the fall of the autocorrelation from one pixel to two."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers


@dataclass(frozen=True)
class VollathF4:
    """Mean of c(x)·(c(x+1) − c(x+2)) along rows: the autocorrelation at one pixel minus that at two pixels.

    White noise contributes to neither, apart from chance. In the published formula, the sum for the nearer neighbour
    has one column more, which adds c² per row of a constant image; here both sums are over the pixels that have both
    neighbours. Stripes along the rows score 0. The score is 0.0 for fewer than three columns. Blur may raise the score
    if most power is above 1/3 cycle per pixel.

    Range: any sign, in squared counts; degree 2; cost 3: two additions and a multiplication per pixel.

    References
    ----------
    .. [1] Vollath, J. Microscopy 147(3), 1987, doi:10.1111/j.1365-2818.1987.tb02839.x.
    .. [2] F4 in Santos et al., J. Microscopy 188(3), 1997, doi:10.1046/j.1365-2818.1997.2630819.x.
    """

    degree: ClassVar[int] = 2
    cost: ClassVar[float] = 3.0
    score_range: ClassVar[str] = "any sign; 0 for constant counts"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type, in squared counts."""
        c = as_integers(counts)
        near, far = c[:, 1:-1], c[:, 2:]
        return float(np.einsum("ij,ij->", c[:, :-2], near - far)) / far.size if c.shape[1] > 2 else 0.0
