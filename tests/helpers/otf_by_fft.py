"""The transfer of a round lens out of focus by two Fourier transforms, a second way to exact_lens_otf."""

import numpy as np


def otf_by_fft(defocus_waves, *, across=256, padded=1024):
    """Fractions 0...1 of the cut-off, and the transfer along an axis by two Fourier transforms of the pupil."""
    x = (np.arange(padded) - padded // 2) / (across / 2)
    radius2 = x[:, None] ** 2 + x**2
    pupil = (radius2 <= 1) * np.exp(2j * np.pi * defocus_waves * radius2)
    point_spread = np.abs(np.fft.fft2(pupil)) ** 2
    transfer = np.fft.ifft2(point_spread)
    transfer = transfer[0, : across + 1].real / transfer[0, 0].real
    return np.arange(across + 1) / across, transfer
