"""The power spectrum of counts in a band of spatial frequencies."""

from functools import lru_cache
from math import log2

import numpy as np
from scipy.fft import rfft2

from saf_gen.errors import BadInput
from saf_gen.plugins.measures._counts import as_floats

FFT_COST = 2.5 * log2(400 * 250)
"""Operations per pixel of a real fast Fourier transform, 2.5 log2 N, at 400 x 250 pixels."""


def check_band(lowest: float, highest: float) -> None:
    """Raise BadInput unless 0 <= lowest < highest <= 0.75 cycles per pixel (the corner of the spectrum is at 0.71)."""
    for key, value in (("lowest", lowest), ("highest", highest)):
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise BadInput(f"{key} is {value!r}", allowed="a frequency in cycles per pixel")
    if not 0 <= lowest < highest <= 0.75:
        raise BadInput(
            f"lowest is {lowest!r}, highest {highest!r}",
            allowed="cycles per pixel, 0 <= lowest < highest <= 0.75",
            hint="pixels carry up to 0.5 along an axis",
        )


def power_in_band(counts: np.ndarray, lowest: float, *, highest: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the power |FFT(c − ū)|²/N² of counts (row, col), and the radius of each frequency.

    Both are float64 (rows, columns), the radius in cycles per pixel. The columns are the horizontal frequencies from 0
    up to ``highest``; the power of a column that also represents its mirror image is doubled. Power outside
    ``lowest`` <= radius <= ``highest`` is 0. Over all frequencies, the power sums to the variance. The array of radii
    is shared between calls and read-only.
    """
    image = as_floats(counts)
    weight, radius = _band(image.shape, lowest, highest=highest)
    image -= image.sum() / image.size
    wave = rfft2(image)[:, : weight.shape[1]]
    return (np.square(wave.real) + np.square(wave.imag)) * weight, radius


@lru_cache(maxsize=16)
def _band(shape: tuple[int, ...], lowest: float, *, highest: float) -> tuple[np.ndarray, np.ndarray]:
    rows, cols = shape
    down, across = np.abs(np.fft.fftfreq(rows)), np.abs(np.fft.rfftfreq(cols))
    twice = np.where((across > 0) & (2 * np.arange(across.size) < cols), 2.0, 1.0)
    kept = np.searchsorted(across, highest, side="right")
    radius = np.hypot(down[:, None], across[None, :kept])
    inside = (radius >= lowest) & (radius <= highest)
    weight = np.where(inside, twice[:kept], 0.0) / (rows * cols) ** 2
    weight.flags.writeable = radius.flags.writeable = False
    return weight, radius
