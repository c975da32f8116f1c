"""Straight edges that a disc has blurred: the closed form of their profile, and the disc that fits a profile."""

import numpy as np
from scipy.optimize import curve_fit


def edge_of_disc(x, blur):
    """Light of pixels whose middles are at x (pixels), across the edge of a half plane at x > 0, blurred by a disc.

    The integral of 1/2 + (asin t + t·√(1 - t²))/π, with t = 2x/blur, over a pixel.
    """

    def integral(x):
        t = np.clip(2 * x / blur, -1, 1)
        root = np.sqrt(1 - t * t)
        inside = t / 2 + (t * np.arcsin(t) + root - root**3 / 3) / np.pi
        return blur / 2 * inside + np.maximum(x - blur / 2, 0)

    return integral(x + 0.5) - integral(x - 0.5)


def fit_edge(profile, blur):
    """The blur, and the distance from the middle, of the edge that is nearest to a profile, in pixels.

    The search begins at ``blur`` and in the middle.
    """
    x = np.arange(profile.size) + 0.5 - profile.size / 2
    first = (blur, 0.0, profile[-1] - profile[0], profile[0])
    return curve_fit(lambda x, c, place, step, low: low + step * edge_of_disc(x - place, c), x, profile, first)[0][:2]
