"""Spike dispersion, independent of the number of pixels."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._moments import squared_contrast


@dataclass(frozen=True)
class SpikeDispersion:
    """Squared contrast of the counts: variance divided by squared mean, V/ū²; 0.0 if there is no spike.

    This is equation 6 of Su et al. without its factor N, so that scores of regions of different size can be compared.
    The score never rises when a periodic scene is blurred further.

    Range 0 to N − 1 for N pixels; degree 0; cost 3: two additions and a multiplication per pixel.

    References
    ----------
    Equation 12 of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363.
    """

    degree: ClassVar[int] = 0
    cost: ClassVar[float] = 3.0
    score_range: ClassVar[str] = "0 ... N - 1 for N pixels"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type."""
        return squared_contrast(counts)
