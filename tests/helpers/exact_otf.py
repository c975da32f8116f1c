"""The exact transfer of a round lens out of focus, for incoherent light and small angles.

Frequencies are fractions of the cut-off 2R/(λ·v). Defocus is the error of the wavefront at the aperture's edge, in
wavelengths.
"""

import numpy as np


def exact_otf(fraction, defocus_waves, *, points=4000):
    """The pupil's overlap with itself, shifted by the frequency (Hopkins 1955, doi:10.1098/rspa.1955.0158).

    In units of R, with the two copies at ±s for the fraction s: a strip at x is 2·√(1 - (|x| + s)²) high, and its
    two ends differ in phase by 2π·W·4·s·x.
    """
    s = np.asarray(fraction, dtype=np.float64)[..., None]
    x = (np.arange(points) + 0.5) / points * (1 - s)
    height = 2 * np.sqrt(np.maximum(0, 1 - (x + s) ** 2))
    return np.mean(height * np.cos(8 * np.pi * defocus_waves * s * x), axis=-1) * 2 * (1 - s[..., 0]) / np.pi


def otf_by_fft(defocus_waves, *, across=256, padded=1024):
    """Fractions 0...1 of the cut-off, and the transfer along an axis by two Fourier transforms of the pupil."""
    x = (np.arange(padded) - padded // 2) / (across / 2)
    radius2 = x[:, None] ** 2 + x**2
    pupil = (radius2 <= 1) * np.exp(2j * np.pi * defocus_waves * radius2)
    point_spread = np.abs(np.fft.fft2(pupil)) ** 2
    transfer = np.fft.ifft2(point_spread)
    transfer = transfer[0, : across + 1].real / transfer[0, 0].real
    return np.arange(across + 1) / across, transfer
