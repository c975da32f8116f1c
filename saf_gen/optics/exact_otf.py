"""Exact optical transfer of a lens with a round aperture, in focus or defocused, for incoherent light and small angles.

Frequencies are fractions of the cut-off 2R/(λ·v). Defocus is the wavefront error at the edge of the aperture, in
wavelengths.
"""

import numpy as np


def exact_otf(fraction: np.ndarray | float, defocus_waves: float, *, points: int = 4000) -> np.ndarray:
    """Return the optical transfer, 1 at frequency 0.

    It is the overlap of two copies of the pupil that are shifted against each other by the frequency. In units of R,
    with the copies at ±s for the fraction s, a strip at x is 2·√(1 - (|x| + s)²) high, and the two copies differ in
    phase by 2π·W·4·s·x there.

    Parameters
    ----------
    fraction : ndarray or float, any shape
        Frequencies divided by the cut-off, 0 to 1.
    defocus_waves : float
        Wavefront error W at the edge of the aperture, wavelengths.
    points : int, default 4000
        Number of strips of the integral.

    References
    ----------
    H. H. Hopkins, The frequency response of a defocused optical system, Proc. R. Soc. A 231, 1955,
    doi:10.1098/rspa.1955.0158.
    """
    s = np.asarray(fraction, dtype=np.float64)[..., None]
    x = (np.arange(points) + 0.5) / points * (1 - s)
    height = 2 * np.sqrt(np.maximum(0, 1 - (x + s) ** 2))
    return np.asarray(
        np.mean(height * np.cos(8 * np.pi * defocus_waves * s * x), axis=-1) * 2 * (1 - s[..., 0]) / np.pi
    )
