"""Variance divided by the mean, the normalisation usual in microscopy."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers
from saf_gen.plugins.measures._moments import variance


@dataclass(frozen=True)
class NormalisedVariance:
    """Variance divided by the mean, V/ū; 0.0 if there is no spike.

    Because of the division, Poisson counts of an even field score 1 at any brightness. The score of a texture still
    grows with the light; V/ū² is ``sd``. The score never rises when a periodic scene is blurred further.

    Range 0 to (N − 1)ū for N pixels, in counts; degree 1; cost 4: three additions and a multiplication per pixel.

    References
    ----------
    .. [1] Groen, Young and Ligthart, Cytometry 6(2), 1985, doi:10.1002/cyto.990060202.
    .. [2] Sun, Duthaler and Nelson, Microscopy Research and Technique 65(3), 2004, doi:10.1002/jemt.20118.
    """

    degree: ClassVar[int] = 1
    cost: ClassVar[float] = 4.0
    score_range: ClassVar[str] = "0 ... (N - 1) mean count for N pixels"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type, in counts."""
        numbers = as_integers(counts)
        total = numbers.sum().item()
        return variance(numbers) * numbers.size / total if total else 0.0
