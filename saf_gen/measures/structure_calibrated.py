"""Structure of the light alone at octaves of scale: sharp at the focus, and still there far from it."""

from dataclasses import dataclass
from math import isfinite
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.measures._counts import MIN_LIGHT_OVER_DARK, as_numbers


@dataclass(frozen=True)
class StructureCalibrated:
    """Mean squared differences of the light between pixels l apart, from two half windows A and B:

        Σ_l S(l)/l / ((ū_A − d_A)·(ū_B − d_B))        l = 1, 2, 4, … ``longest``;  d = dark·frames
        S(l) = Σ over rows and columns of  mean(Δ_l A · Δ_l B) + 2/12 − 2·dark_rms²·d_A·d_B

    S is the structure function of second order. The two halves count on their own, so noise of counting has
    no part in it, as in ``sd_debiased``, but for the spike that they share where they meet (2/12); dark
    spikes and their fixed pattern come out as in ``sd_calibrated``, and ``dark`` and ``dark_rms`` are those.

    The variance, ``sd``, is S at all lengths together, most of it at the longest, which a blur hardly
    touches: a low hill on a pedestal, and as light fades, comes or saturates the pedestal moves more than the
    hill is high. The shortest length alone is a normalised squared gradient: steep, and lost in noise where a
    scene has little detail so fine. An edge lies between the two pixels in l places of a row, so sharp edges
    give S in proportion to l: with 1/l every octave has the same say, and a blur takes the short ones first.

    0.0 where there is hardly any light (a tenth of the dark). Degree 0 but for the 2/12. Cost 34.
    """

    longest: int = 8
    dark: float = 0.0045
    dark_rms: float = 0.48

    halves: ClassVar[bool] = True
    timed: ClassVar[bool] = True
    degree: ClassVar[int] = 0
    source: ClassVar[str] = (
        "ours, after Su et al., Intensity-Robust Autofocus for Spike Camera, CVPR 2024, eq. 12, "
        "doi:10.1109/CVPR52733.2024.02363"
    )
    score_range: ClassVar[str] = "0 expected for no contrast; a few times the squared contrast of the light"

    @property
    def cost(self) -> float:
        """Two sums, and for each length and direction two differences, a product and an addition a pixel."""
        return 2.0 + 8.0 * int(self.longest).bit_length()

    def __post_init__(self) -> None:
        if isinstance(self.longest, bool) or self.longest != int(self.longest) or not 1 <= self.longest <= 64:
            raise BadInput(f"longest is {self.longest!r}", allowed="a whole number of pixels, 1 to 64")
        for key, most in (("dark", 0.5), ("dark_rms", 10.0)):
            value = getattr(self, key)
            if isinstance(value, bool) or not (isfinite(value) and 0 <= value <= most):
                raise BadInput(f"{key} is {value!r}", allowed=f"0 to {most:g}")

    def __call__(self, counts: np.ndarray, frames: int | None = None) -> float:
        """Score of counts (2, row, col), any number type; ``frames`` in both halves together.

        Lengths that the image does not have are left out. Raises BadInput for an image (row, col).
        """
        halves = as_numbers(counts, halves=True).astype(np.float64)  # whole numbers stay exact
        length = frames or 0
        dark = self.dark * (length // 2), self.dark * (length - length // 2)
        light = [float(half.sum()) / half.size - d for half, d in zip(halves, dark, strict=True)]
        if light[0] <= MIN_LIGHT_OVER_DARK * dark[0] or light[1] <= MIN_LIGHT_OVER_DARK * dark[1]:
            return 0.0
        alike = 2 / 12 - 2 * self.dark_rms**2 * dark[0] * dark[1]
        total, apart = 0.0, 1
        while apart <= self.longest:
            for axis in (1, 2):
                if halves.shape[axis] > apart:
                    total += (_shared(halves, apart, axis) + alike) / apart
            apart *= 2
        return total / (light[0] * light[1])


def _shared(halves: np.ndarray, apart: int, axis: int) -> float:
    """Mean product of the differences that both halves show between pixels ``apart`` along an axis."""
    turned = halves if axis == 1 else halves.swapaxes(1, 2)
    first, second = turned[:, apart:] - turned[:, :-apart]
    return float(np.einsum("ij,ij->", first, second)) / first.size
