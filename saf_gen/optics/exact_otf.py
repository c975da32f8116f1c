"""The exact transfer of a round lens, in focus or out of it, for incoherent light and small angles.

Frequencies are fractions of the cut-off 2R/(λ·v). Defocus is the error of the wavefront at the aperture's edge, in
wavelengths.
"""

import numpy as np


def exact_lens_otf(fraction: np.ndarray | float, defocus_waves: float, *, points: int = 4000) -> np.ndarray:
    """Return the pupil's overlap with itself, shifted by the frequency (Hopkins 1955, doi:10.1098/rspa.1955.0158).

    In units of R, with the two copies at ±s for the fraction s: a strip at x is 2·√(1 - (|x| + s)²) high, and its
    two ends differ in phase by 2π·W·4·s·x.

    Parameters
    ----------
    fraction : frequencies over the cut-off, 0 to 1, any shape.
    defocus_waves : W.
    points : strips of the integral.
    """
    s = np.asarray(fraction, dtype=np.float64)[..., None]
    x = (np.arange(points) + 0.5) / points * (1 - s)
    height = 2 * np.sqrt(np.maximum(0, 1 - (x + s) ** 2))
    return np.asarray(
        np.mean(height * np.cos(8 * np.pi * defocus_waves * s * x), axis=-1) * 2 * (1 - s[..., 0]) / np.pi
    )
