"""Transfer of a round lens with aberrations, by a sum over its pupil: nothing of the product is used."""

import numpy as np

ACROSS = 240


def pupil_transfer(waves, *, fractions):
    """Return the complex transfer along x at these fractions of the cut-off frequency.

    ``waves`` is called with points x, y of the pupil (in units of its radius) and returns the wavefront, wavelengths.
    """
    x = (np.arange(ACROSS) + 0.5) / ACROSS * 2 - 1
    x, y = np.meshgrid(x, x)
    found = []
    for s in fractions:
        both = (abs(x) + s) ** 2 + y**2 <= 1
        phase = waves(x[both] + s, y[both]) - waves(x[both] - s, y[both])
        found.append(np.exp(2j * np.pi * phase).sum())
    return np.array(found) / np.count_nonzero(x**2 + y**2 <= 1)


def seidel(*, spherical=0.0, coma=0.0, astigmatism=0.0, field_curvature=0.0, defocus=0.0, eta=(0.0, 0.0)):
    """Return Seidel's sum in wavelengths as a function of points of the pupil, at a point η of the picture."""

    def waves(x, y):
        squared, along = x**2 + y**2, eta[0] * x + eta[1] * y
        field = eta[0] ** 2 + eta[1] ** 2
        return (
            spherical * squared**2
            + coma * along * squared
            + astigmatism * along**2
            + (field_curvature * field + defocus) * squared
        )

    return waves
