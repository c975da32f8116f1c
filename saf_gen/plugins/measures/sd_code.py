"""Spike dispersion as released: it is printed so by Su et al. (CVPR 2024), and their code computes it."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._moments import squared_contrast


@dataclass(frozen=True)
class SpikeDispersionCode:
    """Sum of squared deviations divided by squared mean, Σ(c − ū)²/ū²; 0.0 if there is no spike.

    It is N times ``sd``, and exactly er_sumsq/ū² − N. The score never rises when a periodic scene is blurred further.

    Range 0 to N(N − 1) for N pixels; degree 0; cost 3, as for ``sd``.

    References
    ----------
    Equation 6 and the released code of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363.
    """

    degree: ClassVar[int] = 0
    cost: ClassVar[float] = 3.0
    score_range: ClassVar[str] = "0 ... N(N - 1) for N pixels"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type."""
        return squared_contrast(counts, pixels=True)
