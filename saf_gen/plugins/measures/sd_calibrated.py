"""Spike dispersion of the light alone, without the bias from counting noise and from dark spikes."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers, subtract_dark
from saf_gen.plugins.measures._options import check_dark_options


@dataclass(frozen=True)
class SpikeDispersionCalibrated:
    """Squared contrast of the light, from the two halves A and B of a window.

    The score is

        (cov(A, B) + 1/12 − dark_rms²·d_A·d_B) / ((ū_A − d_A)·(ū_B − d_B))          d = dark·frames

    This is ``sd_debiased`` with the dark spikes subtracted. Their rate does not change with the light, so in ``sd``
    they reduce the contrast as the light falls, and their fixed pattern looks like texture. ``dark`` is their mean
    rate, in spikes per pixel and readout, so that d is the mean dark count of a half. ``dark_rms`` is the rms of that
    rate over pixels, relative to its mean. Both follow from one recording with the lens cap on; the defaults are those
    of the sensor ``vidar_400x250``. The score does not change with the light as long as each half counts a few spikes
    per pixel; see the search ``photon_aware``. The 1/12 is an average over the fractions of a count, as in
    ``sd_debiased``. If the length of the window is not given, d is 0, and both measures give the same score. The score
    is 0.0 if the light of a half is at most a tenth of its dark counts.

    Range: expected value 0 without contrast, otherwise about the squared contrast; degree 0 apart from the 1/12;
    cost 4: one multiplication and three additions per pixel.

    References
    ----------
    This project, after equation 12 of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363.
    """

    dark: float = 0.0045
    dark_rms: float = 0.48

    halves: ClassVar[bool] = True
    timed: ClassVar[bool] = True
    degree: ClassVar[int] = 0
    cost: ClassVar[float] = 4.0
    score_range: ClassVar[str] = "0 expected for no contrast; about the squared contrast of the light"

    def __post_init__(self) -> None:
        check_dark_options(self.dark, self.dark_rms)

    def __call__(self, counts: np.ndarray, frames: int | None = None) -> float:
        """Return the score of counts (2, row, col) of any number type; ``frames`` is the length of both halves."""
        first, second = as_integers(counts, halves=True)
        means = first.sum().item() / first.size, second.sum().item() / second.size
        split = subtract_dark(means, self.dark, frames=frames or 0)
        if split is None:
            return 0.0
        light, dark = split
        covariance = np.vdot(first, second).item() / first.size - means[0] * means[1]
        return (covariance + 1 / 12 - self.dark_rms**2 * dark[0] * dark[1]) / (light[0] * light[1])
