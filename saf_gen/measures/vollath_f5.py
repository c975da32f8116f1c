"""Vollath's F5: variance without what neighbours do not share."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.measures._counts import as_numbers


@dataclass(frozen=True)
class VollathF5:
    """Autocorrelation at one pixel along rows less the squared mean: mean of c(x)·c(x+1), less ū².

    The variance of what neighbours share: white noise adds nothing but for chance. The published sums run
    over one column less than the mean does, which leaves −c² a row; here each is a mean of its own. A column
    more or less at the border still matters on small images. 0.0 for a single column.

    Blur may raise it where most power lies beyond 1/4 cycle a pixel. Squared counts, any sign, degree 2,
    cost 3: two additions and a multiplication a pixel.
    """

    degree: ClassVar[int] = 2
    cost: ClassVar[float] = 3.0
    source: ClassVar[str] = (
        "Vollath, The influence of the scene parameters and of noise on the behaviour of automatic focusing "
        "algorithms, J. Microscopy 151(2), 1988, doi:10.1111/j.1365-2818.1988.tb04620.x"
    )
    score_range: ClassVar[str] = "any sign; 0 for constant counts"

    def __call__(self, counts: np.ndarray) -> float:
        """Score of counts (row, col), any number type, squared counts."""
        c = as_numbers(counts)
        pairs = c[:, 1:].size
        if not pairs:
            return 0.0
        shared = np.einsum("ij,ij->", c[:, :-1], c[:, 1:]).item()
        # Both means over one denominator: whole numbers go through Python integers and are rounded once.
        return (shared * c.size**2 - c.sum().item() ** 2 * pairs) / (pairs * c.size**2)
