"""Variance of the counts."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.measures._counts import as_numbers
from saf_gen.measures._moments import variance


@dataclass(frozen=True)
class Variance:
    """Variance over pixels, V = mean of (c − ū)². Its twin ``variance_n`` is spike dispersion, ``sd``.

    Never rises when a periodic scene is blurred further. Squared counts, range from 0, degree 2, cost 3:
    two additions and a multiplication a pixel.
    """

    degree: ClassVar[int] = 2
    cost: ClassVar[float] = 3.0
    source: ClassVar[str] = (
        "Groen, Young and Ligthart, A comparison of different focus functions for use in autofocus "
        "algorithms, Cytometry 6(2), 1985, doi:10.1002/cyto.990060202"
    )
    score_range: ClassVar[str] = "from 0; 0 for constant counts"

    def __call__(self, counts: np.ndarray) -> float:
        """Score of counts (row, col), any number type, squared counts."""
        return variance(as_numbers(counts))
