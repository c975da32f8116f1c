"""Vollath's F5: the variance that neighbouring pixels share."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers


@dataclass(frozen=True)
class VollathF5:
    """Mean of c(x)·c(x+1) along rows minus the squared mean ū²: the covariance of neighbours.

    White noise adds nothing, apart from chance. In the published formula, the sum of products has one column less than
    the mean, which leaves −c² per row of a constant image. Here each is a mean over its columns, so on small images one
    column more or less at the border matters. The score is 0.0 for a single column. Blur may raise the score if most
    power is above 1/4 cycle per pixel.

    Range: any sign, in squared counts; degree 2; cost 3: two additions and a multiplication per pixel.

    References
    ----------
    Vollath, J. Microscopy 151(2), 1988, doi:10.1111/j.1365-2818.1988.tb04620.x.
    """

    degree: ClassVar[int] = 2
    cost: ClassVar[float] = 3.0
    score_range: ClassVar[str] = "any sign; 0 for constant counts"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type, in squared counts."""
        c = as_integers(counts)
        pairs = c[:, 1:].size
        if not pairs:
            return 0.0
        products = np.einsum("ij,ij->", c[:, :-1], c[:, 1:]).item()
        # Both means have one denominator, so that whole numbers stay Python integers and only the quotient is rounded.
        return (products * c.size**2 - c.sum().item() ** 2 * pairs) / (pairs * c.size**2)
