"""Spike dispersion without the share of counting itself: from the two halves of a window."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.measures._counts import as_numbers


@dataclass(frozen=True)
class SpikeDispersionDebiased:
    """Squared contrast from two half windows A and B: (cov(A, B) + 1/12)/(ū_A·ū_B) over pixels.

    Takes counts (2, row, col): the first half of the frames and the rest, contiguous. Noise that the halves
    do not share drops out of a covariance. What they do share is the charge left over between them. It gives
    −1/12 where fractions of a count are spread evenly over the pixels, as they are where the counts of a half
    span a count or more. Over a narrower span it gives 0 to −1/4, and what 1/12 leaves of that may exceed the
    error of ``sd``; an even field may score below 0. Odd and even frames are no halves: they share out one
    train of spikes, and their covariance lies far lower.

    0.0 where a half holds no spike. Range above −1 ... N − 1 + N²/12 (one spike a half, in the same pixel).
    Degree 0 but for the 1/12, which is in squared counts. Cost 4: three additions and a
    multiplication a pixel.
    """

    halves: ClassVar[bool] = True
    degree: ClassVar[int] = 0
    cost: ClassVar[float] = 4.0
    source: ClassVar[str] = (
        "ours, after Su et al., Intensity-Robust Autofocus for Spike Camera, CVPR 2024, eq. 12, "
        "doi:10.1109/CVPR52733.2024.02363"
    )
    score_range: ClassVar[str] = "above -1 ... N - 1 + N^2/12 for N pixels; 0 expected for no contrast"

    def __call__(self, counts: np.ndarray) -> float:
        """Score of counts (2, row, col), any number type. Raises BadInput for an image (row, col)."""
        first, second = as_numbers(counts, halves=True)
        size, sums = first.size, (first.sum().item(), second.sum().item())
        if 0 in sums:
            return 0.0
        # Times 12 N², so that whole numbers go through Python integers and are rounded once.
        shared = size * np.vdot(first, second).item() - sums[0] * sums[1]
        return (12 * shared + size**2) / (12 * sums[0] * sums[1])
