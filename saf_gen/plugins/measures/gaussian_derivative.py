"""Energy of the gradient at a chosen scale: it comes from derivatives of a Gaussian."""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_floats
from saf_gen.plugins.measures._filters import correlate_separable
from saf_gen.plugins.measures._moments import mean_square
from saf_gen.plugins.measures._options import check_range


@dataclass(frozen=True)
class GaussianDerivative:
    """Mean of (c * Gx)² + (c * Gy)² where the kernel fits, with G a Gaussian of ``sigma_px`` cut off at 3 sigma.

    The smoothing suppresses noise; the source uses sigma = d/√12 for details of d pixels. A ramp of s counts per pixel
    scores s² at any scale, and white noise of variance v scores about v/(4π·sigma⁴). The score is 0.0 if the kernel of
    2·⌈3 sigma⌉ + 1 pixels does not fit into the image, and never rises when a periodic scene is blurred further.

    Range from 0, in squared counts per squared pixel; degree 2; cost 8K + 4 for a kernel of K pixels, four
    passes along rows or columns (60 at sigma 1).

    References
    ----------
    Geusebroek et al., "Robust autofocusing in microscopy", Cytometry 39(1), 2000,
    doi:10.1002/(SICI)1097-0320(20000101)39:1<1::AID-CYTO2>3.0.CO;2-J.
    """

    sigma_px: float = 1.0

    degree: ClassVar[int] = 2
    score_range: ClassVar[str] = "from 0; 0 for constant counts"

    def __post_init__(self) -> None:
        check_range("sigma_px", self.sigma_px, lowest=0.3, highest=30, unit=" pixels")

    @property
    def cost(self) -> float:
        """Additions and multiplications per pixel."""
        return 8.0 * _kernels(self.sigma_px)[0].size + 4

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type, in squared counts per squared pixel."""
        smooth, slope = _kernels(self.sigma_px)
        c = as_floats(counts)
        if min(c.shape) < smooth.size:
            return 0.0
        return mean_square(correlate_separable(c, smooth, slope, 1)) + mean_square(
            correlate_separable(c, slope, smooth, 1)
        )


@lru_cache(maxsize=16)
def _kernels(sigma_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a smoothing kernel that preserves constants, and a derivative kernel that gives the slope of a ramp."""
    reach = int(np.ceil(3 * sigma_px))
    x = np.arange(-reach, reach + 1, dtype=np.float64)
    bell = np.exp(-0.5 * (x / sigma_px) ** 2)
    return bell / bell.sum(), x * bell / (x**2 * bell).sum()
