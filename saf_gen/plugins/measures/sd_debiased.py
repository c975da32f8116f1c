"""Spike dispersion without the bias from counting noise, from the two halves of a window."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers


@dataclass(frozen=True)
class SpikeDispersionDebiased:
    """Squared contrast from two half windows A and B: (cov(A, B) + 1/12)/(ū_A·ū_B) over pixels.

    The counts, (2, row, col), are those of the first half of the frames and of the rest. Noise that the halves do not
    share cancels in the covariance. They do share the charge that is left over at the end of the first half. It adds
    −1/12 (the average of the exact law, docs/spike-camera.md) if fractions of a count are distributed
    evenly over the pixels, as they are if the counts of a half span one count or more. Over a narrower span, it adds 0
    to −1/4, which 1/12 does not balance: the error may exceed the error of ``sd``, and an even field may score below 0.
    Odd and even frames cannot replace the halves: they divide one train of spikes, and their covariance is far lower.
    The score is 0.0 if a half has no spike.

    Range above −1, to N − 1 + N²/12 (one spike per half, in the same pixel); degree 0 apart from the 1/12,
    which is in squared counts; cost 4: three additions and a multiplication per pixel.

    References
    ----------
    This project, after equation 12 of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363.
    """

    halves: ClassVar[bool] = True
    degree: ClassVar[int] = 0
    cost: ClassVar[float] = 4.0
    score_range: ClassVar[str] = "above -1 ... N - 1 + N^2/12 for N pixels; 0 expected for no contrast"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (2, row, col) of any number type."""
        first, second = as_integers(counts, halves=True)
        size, sums = first.size, (first.sum().item(), second.sum().item())
        if 0 in sums:
            return 0.0
        # Multiplied by 12 N², so that whole numbers stay Python integers and only the quotient is rounded.
        covariance = size * np.vdot(first, second).item() - sums[0] * sums[1]
        return (12 * covariance + size**2) / (12 * sums[0] * sums[1])
