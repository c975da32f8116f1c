"""Vollath's F4: how fast the autocorrelation falls."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.measures._counts import as_numbers


@dataclass(frozen=True)
class VollathF4:
    """Autocorrelation at one pixel less that at two, along rows: mean of c(x)·(c(x+1) − c(x+2)).

    White noise has no part in either, so that it cancels but for chance. The published sums run over one
    column more for the nearer neighbour, which lets brightness through (c² a row); here both run over the
    pixels that have both neighbours. Stripes along the rows score 0. 0.0 for fewer than three columns.

    Blur may raise it where most power lies beyond 1/3 cycle a pixel. Squared counts, any sign, degree 2,
    cost 3: two additions and a multiplication a pixel.
    """

    degree: ClassVar[int] = 2
    cost: ClassVar[float] = 3.0
    source: ClassVar[str] = (
        "Vollath, Automatic focusing by correlative methods, J. Microscopy 147(3), 1987, "
        "doi:10.1111/j.1365-2818.1987.tb02839.x; F4 in Santos et al., J. Microscopy 188(3), 1997, "
        "doi:10.1046/j.1365-2818.1997.2630819.x"
    )
    score_range: ClassVar[str] = "any sign; 0 for constant counts"

    def __call__(self, counts: np.ndarray) -> float:
        """Score of counts (row, col), any number type, squared counts."""
        c = as_numbers(counts)
        near, far = c[:, 1:-1], c[:, 2:]
        return float(np.einsum("ij,ij->", c[:, :-2], near - far)) / far.size if c.shape[1] > 2 else 0.0
