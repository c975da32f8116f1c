"""Structure of the light between octaves of scale, unaffected by white noise and therefore without calibration."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers
from saf_gen.plugins.measures._options import check_whole_number


@dataclass(frozen=True)
class OctaveStructure:
    """Growth of mean squared pixel differences from each distance to its double, divided by squared brightness.

    The score is

        Σ_l (S(2l) − S(l))/l / ū²        l = 1, 2, 4, … ``longest``
        S(l) = mean over rows of (c(x + l) − c(x))², plus the same over columns

    where c are the counts, ū is their mean, and S is the second-order structure function. Noise that is white over
    pixels, however large, adds the same amount to S at every distance: counting noise, threshold and reset noise, and
    the fixed pattern of the dark current. It cancels in the difference, so the measure needs no calibration that could
    be wrong. In terms of the autocorrelation R of the counts, the difference is 2·(R(l) − R(2l)), which for l = 1 is
    Vollath's F4 over both axes; the higher octaves respond to blurred edges farther from the focus. The mean dark rate
    d is not subtracted from ū. It lowers the score by the factor (1 − d/ū)², which is the same for all positions of the
    lens while the light is constant. Distances that do not fit into the image are left out, and the score is 0.0 if no
    pixel counted a spike. Like F4, the score does not fall with every blur: stripes with a period of two pixels score
    below 0, because neighbouring pixels differ and pixels two apart do not.

    Range: expected value 0 without texture, whatever the noise, otherwise a few times the squared contrast; degree 0;
    cost 37 with the default distances: the mean, and per distance and axis two differences, two products and two
    additions per pixel.

    References
    ----------
    This project, after D. Vollath, J. Microsc. 147, 1987, doi:10.1111/j.1365-2818.1987.tb02839.x.
    """

    longest: int = 4

    degree: ClassVar[int] = 0
    score_range: ClassVar[str] = "0 expected for white noise; a few times the squared contrast of a texture"

    @property
    def cost(self) -> float:
        """Operations per pixel: the mean, and per distance and axis two differences, two products and two additions."""
        return 1.0 + 12.0 * self.longest.bit_length()

    def __post_init__(self) -> None:
        check_whole_number("longest", self.longest, highest=32, unit="number of pixels")

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type."""
        image = as_integers(counts).astype(np.float64)
        mean = image.sum() / image.size
        if not mean:
            return 0.0
        total, apart = 0.0, 1
        while apart <= self.longest:
            for turned in (image, image.T):
                if len(turned) > 2 * apart:
                    total += (_structure(turned, 2 * apart) - _structure(turned, apart)) / apart
            apart *= 2
        return float(total / mean**2)


def _structure(image: np.ndarray, apart: int) -> float:
    """Return the mean squared difference of pixels ``apart`` rows apart."""
    difference = image[apart:] - image[:-apart]
    return float(np.einsum("ij,ij->", difference, difference)) / difference.size
