"""Mid-frequency DCT of the entire image, as published."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers


@dataclass(frozen=True)
class MidFrequencyDct:
    """Σ(O * c)² over the pixels where the 4×4 kernel O = vvᵀ, v = (1, 1, −1, −1), fits.

    O is the middle frequency of a 4×4 cosine transform, with its weights rounded to signs. It sums to 0, so constant
    counts score 0. The score is 0.0 for fewer than four rows or columns, and never rises when a periodic scene is
    blurred further.

    Range from 0, in squared counts; degree 2; cost 8: seven additions and a multiplication per pixel.

    References
    ----------
    Lee et al., IEEE TCSVT 18(9), 2008, doi:10.1109/TCSVT.2008.924105.
    """

    degree: ClassVar[int] = 2
    cost: ClassVar[float] = 8.0
    score_range: ClassVar[str] = "from 0; 0 for constant counts"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type."""
        c = as_integers(counts)
        if min(c.shape) < 4:
            return 0.0
        down = c[:-3] + c[1:-2] - c[2:-1] - c[3:]
        both = down[:, :-3] + down[:, 1:-2] - down[:, 2:-1] - down[:, 3:]
        return float(np.square(both).sum())
