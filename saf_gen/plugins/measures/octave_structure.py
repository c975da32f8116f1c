"""Structure of the light between octaves of scale, free of everything that is white over pixels: no calibration."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import counts_as_integers
from saf_gen.plugins.measures._options import check_measure_whole_number


@dataclass(frozen=True)
class OctaveStructure:
    """How much mean squared differences grow from one length to twice that length, over brightness:

        Σ_l (S(2l) − S(l))/l / ū²        l = 1, 2, 4, … ``longest``
        S(l) = mean over rows of (c(x + l) − c(x))², plus the same over columns

    S is the structure function of second order. What is white over pixels, of whatever size, adds the same to S at
    every length: the noise of counting, that of thresholds and resets, and the fixed pattern of the dark current. It
    drops out of the difference, so that no calibration is needed and none can be wrong. In terms of the autocorrelation
    R of the counts the difference is 2·(R(l) − R(2l)), which for l = 1 is Vollath's F4 over both axes; the octaves
    above see blurred edges from farther away. The mean dark rate d is not taken off ū: it thins the score out by
    (1 − d/ū)², for all positions of the lens alike as long as the light stays. Pairs of lengths that the image does not
    have are left out; the score is 0.0 where no pixel counted a spike. Like F4 it need not fall with every blur:
    stripes of two pixels differ from their neighbours and not from the next but one, and score below 0.

    Range: 0 expected without texture, whatever the noise; else a few times the squared contrast; degree 0; cost 37 for
    the lengths by default: per length and axis two differences, products and additions for each pixel, and the mean.

    References
    ----------
    This project, after D. Vollath, J. Microsc. 147, 1987, doi:10.1111/j.1365-2818.1987.tb02839.x.
    """

    longest: int = 4

    degree: ClassVar[int] = 0
    score_range: ClassVar[str] = "0 expected for white noise; a few times the squared contrast of a texture"

    @property
    def cost(self) -> float:
        """The mean, and for each length and axis two differences, products and additions per pixel."""
        return 1.0 + 12.0 * self.longest.bit_length()

    def __post_init__(self) -> None:
        check_measure_whole_number("longest", self.longest, highest=32, unit="number of pixels")

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type."""
        image = counts_as_integers(counts).astype(np.float64)
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
