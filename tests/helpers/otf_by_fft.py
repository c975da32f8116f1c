"""The transfer of a defocused round lens by two Fourier transforms, an independent computation of exact_otf."""

import numpy as np


def otf_by_fft(defocus_waves, *, across=256, padded=1024):
    """Return fractions 0...1 of the cut-off frequency and the transfer at them along an axis."""
    x = (np.arange(padded) - padded // 2) / (across / 2)
    radius2 = x[:, None] ** 2 + x**2
    pupil = (radius2 <= 1) * np.exp(2j * np.pi * defocus_waves * radius2)
    point_spread = np.abs(np.fft.fft2(pupil)) ** 2
    transfer = np.fft.ifft2(point_spread)
    transfer = transfer[0, : across + 1].real / transfer[0, 0].real
    return np.arange(across + 1) / across, transfer
