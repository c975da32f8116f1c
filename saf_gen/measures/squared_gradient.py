"""Squared gradient: squared difference of neighbours."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.measures._counts import as_numbers
from saf_gen.measures._moments import mean_square


@dataclass(frozen=True)
class SquaredGradient:
    """Mean of (c(x+1) − c(x))² along rows, no threshold: stripes that run along the rows score 0.

    A ramp of s counts a pixel scores s², white noise twice its variance, a period of two pixels most.
    0.0 for a single column.

    Never rises when a periodic scene is blurred further. Squared counts, range from 0, degree 2, cost 3:
    two additions and a multiplication a pixel.
    """

    degree: ClassVar[int] = 2
    cost: ClassVar[float] = 3.0
    source: ClassVar[str] = (
        "Santos et al., J. Microscopy 188(3), 1997, doi:10.1046/j.1365-2818.1997.2630819.x; GRAS of Pertuz "
        "et al., Pattern Recognition 46(5), 2013, doi:10.1016/j.patcog.2012.11.011"
    )
    score_range: ClassVar[str] = "from 0; 0 for constant counts"

    def __call__(self, counts: np.ndarray) -> float:
        """Score of counts (row, col), any number type, squared counts."""
        c = as_numbers(counts)
        return mean_square(c[:, 1:] - c[:, :-1])
