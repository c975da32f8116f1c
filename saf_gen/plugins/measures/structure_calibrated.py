"""Calibrated structure of the light at octaves of scale: its focus curve has a sharp peak with a wide base."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers, subtract_dark
from saf_gen.plugins.measures._options import check_dark_options, check_whole_number


@dataclass(frozen=True)
class StructureCalibrated:
    """Mean squared differences of the light over several distances, from the two halves A and B of a window.

    The score, summed over distances l between pixels, is

        Σ_l S(l)/l / ((ū_A − d_A)·(ū_B − d_B))        l = 1, 2, 4, … ``longest``;  d = dark·frames
        S(l) = Σ over rows and columns of  mean(Δ_l A · Δ_l B) + 2/12 − 2·dark_rms²·d_A·d_B

    S is the second-order structure function. The two halves count independently, so shot noise cancels as in
    ``sd_debiased``, except for the spike that they share where they meet. Twice 1/12, an average over the fractions of
    a count, corrects for this spike, as in that measure. Dark spikes and their fixed pattern are subtracted as in
    ``sd_calibrated``, with the same ``dark`` and ``dark_rms``.

    The variance, as in ``sd``, is dominated by the longest scales, which blur barely changes: its focus curve is a low
    hill on a pedestal, and the pedestal changes by more than the height of the hill as the light changes. The shortest
    distance alone gives a normalised squared gradient, which is steep, but lost in noise if a scene has little detail
    that fine. An edge is between the two pixels for l neighbouring pairs, so S of sharp edges is proportional to l: the
    factor 1/l gives every octave the same weight, and blur reduces the short distances first. Distances that do not fit
    into the image are left out. The score is 0.0 if the light of a half is at most a tenth of its dark counts.

    Range: expected value 0 without contrast, otherwise a few times the squared contrast; degree 0 apart from the 2/12;
    cost 34 with the four default distances.

    References
    ----------
    This project, after equation 12 of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363.
    """

    longest: int = 8
    dark: float = 0.0045
    dark_rms: float = 0.48

    halves: ClassVar[bool] = True
    timed: ClassVar[bool] = True
    degree: ClassVar[int] = 0
    score_range: ClassVar[str] = "0 expected for no contrast; a few times the squared contrast of the light"

    @property
    def cost(self) -> float:
        """Operations per pixel: two sums, and per distance and axis two differences, a product and an addition."""
        return 2.0 + 8.0 * self.longest.bit_length()

    def __post_init__(self) -> None:
        check_whole_number("longest", self.longest, highest=64, unit="number of pixels")
        check_dark_options(self.dark, self.dark_rms)

    def __call__(self, counts: np.ndarray, frames: int | None = None) -> float:
        """Return the score of counts (2, row, col) of any number type; ``frames`` is the length of both halves."""
        halves = as_integers(counts, halves=True).astype(np.float64)  # whole numbers stay exact
        means = float(halves[0].sum()) / halves[0].size, float(halves[1].sum()) / halves[1].size
        split = subtract_dark(means, self.dark, frames=frames or 0)
        if split is None:
            return 0.0
        light, dark = split
        correction = 2 / 12 - 2 * self.dark_rms**2 * dark[0] * dark[1]
        total, apart = 0.0, 1
        while apart <= self.longest:
            for axis in (1, 2):
                if halves.shape[axis] > apart:
                    total += (_structure(halves, apart, axis=axis) + correction) / apart
            apart *= 2
        return total / (light[0] * light[1])


def _structure(halves: np.ndarray, apart: int, *, axis: int) -> float:
    """Return the mean product of the differences, in the two halves, between pixels ``apart`` from each other."""
    turned = halves if axis == 1 else halves.swapaxes(1, 2)
    first, second = turned[:, apart:] - turned[:, :-apart]
    return float(np.einsum("ij,ij->", first, second)) / first.size
