"""Brenner's gradient: squared differences of pixels two apart."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers
from saf_gen.plugins.measures._moments import mean_square


@dataclass(frozen=True)
class Brenner:
    """Mean of (c(x+2) − c(x))² along rows.

    A ramp of s counts per pixel scores 4s², and white noise scores twice its variance. A pattern with a period of four
    pixels scores highest, and stripes along the rows score 0, as published. The score is 0.0 for fewer than three
    columns, and never rises when a periodic scene is blurred further.

    Range from 0, in squared counts; degree 2; cost 3: two additions and a multiplication per pixel.

    References
    ----------
    .. [1] Brenner et al., J. Histochemistry and Cytochemistry 24(1), 1976, doi:10.1177/24.1.1254907.
    .. [2] Santos et al., J. Microscopy 188(3), 1997, doi:10.1046/j.1365-2818.1997.2630819.x.
    """

    degree: ClassVar[int] = 2
    cost: ClassVar[float] = 3.0
    score_range: ClassVar[str] = "from 0; 0 for constant counts"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type, in squared counts."""
        c = as_integers(counts)
        return mean_square(c[:, 2:] - c[:, :-2])
