"""Variance of the counts."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers
from saf_gen.plugins.measures._moments import variance


@dataclass(frozen=True)
class Variance:
    """Variance over pixels, V = mean of (c − ū)². Its brightness-normalised form, ``variance_n``, is ``sd``.

    The score never rises when a periodic scene is blurred further.

    Range from 0, in squared counts; degree 2; cost 3: two additions and a multiplication per pixel.

    References
    ----------
    Groen, Young and Ligthart, Cytometry 6(2), 1985, doi:10.1002/cyto.990060202.
    """

    degree: ClassVar[int] = 2
    cost: ClassVar[float] = 3.0
    score_range: ClassVar[str] = "from 0; 0 for constant counts"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type, in squared counts."""
        return variance(as_integers(counts))
