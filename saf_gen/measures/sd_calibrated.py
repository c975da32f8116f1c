"""Spike dispersion of the light alone: counting and the dark taken out, as a calibrated camera can."""

from dataclasses import dataclass
from math import isfinite
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.measures._counts import MIN_LIGHT_OVER_DARK, as_numbers


@dataclass(frozen=True)
class SpikeDispersionCalibrated:
    """Squared contrast of the light, from two half windows A and B of a and b frames:

        (cov(A, B) + 1/12 − dark_rms²·d_A·d_B) / ((ū_A − d_A)·(ū_B − d_B))          d = dark·frames

    As ``sd_debiased``, without the dark spikes. They are the same at all times, so in ``sd`` they thin the
    contrast out as light falls, and their fixed pattern looks like texture. ``dark``: their mean rate, spikes
    a pixel and readout; ``dark_rms``: the rms of that rate over pixels, relative to its mean. Both come from
    one recording with the lens cap on (here: the sensor ``vidar_400x250``). Then the score does not move with
    the light, as long as each half counts a few spikes a pixel: see the search ``photon_aware``.

    Without the length of the window it is ``sd_debiased``. 0.0 where there is hardly any light (a tenth of
    the dark). Degree 0 but for the 1/12. Cost 4: one multiplication, three additions a pixel.
    """

    dark: float = 0.0045
    dark_rms: float = 0.48

    halves: ClassVar[bool] = True
    timed: ClassVar[bool] = True
    degree: ClassVar[int] = 0
    cost: ClassVar[float] = 4.0
    source: ClassVar[str] = (
        "ours, after Su et al., Intensity-Robust Autofocus for Spike Camera, CVPR 2024, eq. 12, "
        "doi:10.1109/CVPR52733.2024.02363"
    )
    score_range: ClassVar[str] = "0 expected for no contrast; about the squared contrast of the light"

    def __post_init__(self) -> None:
        for key, most in (("dark", 0.5), ("dark_rms", 10.0)):
            value = getattr(self, key)
            if isinstance(value, bool) or not (isfinite(value) and 0 <= value <= most):
                raise BadInput(f"{key} is {value!r}", allowed=f"0 to {most:g}")

    def __call__(self, counts: np.ndarray, frames: int | None = None) -> float:
        """Score of counts (2, row, col), any number type; ``frames`` in both halves together.

        Raises BadInput for an image (row, col).
        """
        first, second = as_numbers(counts, halves=True)
        length = frames or 0
        dark = self.dark * (length // 2), self.dark * (length - length // 2)
        means = first.sum().item() / first.size, second.sum().item() / second.size
        light = means[0] - dark[0], means[1] - dark[1]
        if light[0] <= MIN_LIGHT_OVER_DARK * dark[0] or light[1] <= MIN_LIGHT_OVER_DARK * dark[1]:
            return 0.0
        shared = np.vdot(first, second).item() / first.size - means[0] * means[1]
        return (shared + 1 / 12 - self.dark_rms**2 * dark[0] * dark[1]) / (light[0] * light[1])
