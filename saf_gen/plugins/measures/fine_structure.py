"""Structure without noise and shading: weighted differences of pixels one, two and four apart."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.core.block_structure import block_structure
from saf_gen.plugins.measures._counts import as_integers


@dataclass(frozen=True)
class FineStructure:
    """Second difference of the structure function over octaves, divided by squared brightness.

    The score is

        (5·S(2) − 4·S(1) − S(4)) / ū²

    where S(l) is the mean of (c(x + l) − c(x))² over all pairs of counts l pixels apart along rows and columns, and ū
    is the mean count. White noise adds the same to S at each distance and cancels, as in ``octave_structure``: counting
    noise, threshold and reset noise, the fixed pattern of the dark current. Brightness that changes slowly over the
    picture adds to S in proportion to l², and cancels too: shading, and the light of surroundings that leaks in out of
    focus, which ``octave_structure`` and ``vollath_f4`` see. What is left is fine structure, most of it with periods of
    four to six pixels. Like F4, the measure is blind to stripes with a period of three pixels, and scores shorter ones
    below 0. A distance that does not fit into the image is left out, and an image without a spike scores 0.

    Range: expected value 0 for noise and for shading, otherwise at most a few times the squared contrast; degree 0;
    cost 19: the mean, and for three distances along two axes a difference, a product and an addition per pixel.

    References
    ----------
    This project. Structure functions: A. N. Kolmogorov, Dokl. Akad. Nauk SSSR 30, 1941.
    """

    degree: ClassVar[int] = 0
    cost: ClassVar[float] = 19.0
    score_range: ClassVar[str] = "any sign; expected value 0 for noise and for shading"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type."""
        image = as_integers(counts)
        rows, columns = (np.array([0, n]) for n in image.shape)
        return float(block_structure(image, (rows, columns))[0, 0])
