"""Event rate as a sum of squares: how the released code of Su et al. applies it to spikes."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers
from saf_gen.plugins.measures._moments import sum_of_squares


@dataclass(frozen=True)
class EventRateSquares:
    """Sum of squared counts, Σc²: it follows the light by construction (sd_code = er_sumsq/ū² − N).

    The score never rises when a periodic scene is blurred further.

    Range 0 to N·n² for N pixels and n frames; degree 2; cost 2: a multiplication and an addition per pixel.

    References
    ----------
    .. [1] Released code of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363.
    .. [2] Lin et al., "Autofocus for Event Cameras", CVPR 2022, doi:10.1109/CVPR52688.2022.01586.
    """

    degree: ClassVar[int] = 2
    cost: ClassVar[float] = 2.0
    score_range: ClassVar[str] = "0 ... N n^2 for N pixels and n frames"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type."""
        return float(sum_of_squares(as_integers(counts)))
