"""The colour of a lens read from a file: its axial colour, and what pictures mixed from those of one wavelength lack.

The polynomials of a lens know its rays at every wavelength. In focus on the axis, at the middle of the travel, is for
light λ the plane whose rays have least squared slopes: if w(a) is what aberrations add to the slope of the ray through
a, then 1/u changes by δ(λ) = -Σ a·(w_λ - w_0)/Σ a² over the aperture. Pictures in light λ are those of the position
that δ names (:mod:`saf_gen.optics.axial_colour`). What is left are rays of λ that land beside those pictures: all of a
point's rays together, which is lateral colour and the scale of a moved lens, and each beside their mean, which is
spherochromatism and its kin off the axis. Both are measured here, ray by ray.
"""

from typing import NamedTuple

import numpy as np

from saf_gen.optics.axial_colour import AxialColour, shifted_positions
from saf_gen.optics.fitted_lens_drive import FittedLensDrive
from saf_gen.optics.lens_file.fitted_file import FittedLens
from saf_gen.optics.texture_contrast import lens_points

STEP_NM, DIGITS = 10.0, 9
MIDDLE = 0.5  # of the travel
HEIGHTS = (0.0, 0.7, 1.0)  # of the picture's corner


class Neglected(NamedTuple):
    """How far rays are from where a mixed picture has them, root of the mean square over the light, metres.

    Attributes
    ----------
    lateral_m : float
        Distance of the middles of the bundles of a point, at the height where it is largest.
    blur_m : float
        Distance of the rays of a bundle from their middle, beyond those of the picture, where it is largest.
    """

    lateral_m: float
    blur_m: float


def lens_colour(lens: FittedLens, drive: FittedLensDrive, *, drawn_nm: float) -> AxialColour:
    """Return the axial colour of a lens whose pictures are drawn in light of ``drawn_nm``.

    Beyond the wavelengths for which the lens is fitted, light is taken to focus as at their ends.
    """
    low, high = lens.waves_nm
    waves = np.append(np.arange(low, high - 1e-6, STEP_NM), high)
    a = lens_points(drive.aperture_radius_m)
    v, u = float(drive.image_distance(MIDDLE)), float(drive.object_distance(MIDDLE))
    fit, along, size = lens.fit, [], float((a[0] ** 2 + a[1] ** 2).sum())
    for nm in (drawn_nm, *waves):
        slope = fit.at(float(nm)).seen_from(u, v).slope(a, (0.0, 0.0))
        along.append(float((a[0] * slope[0] + a[1] * slope[1]).sum()) / size)
    power = 1 - drive.focal_length_m * (np.array(along[1:]) - along[0])
    shifts = np.round(1 / power - 1, DIGITS)
    pairs = zip(np.round(waves, 6).tolist(), shifts.tolist(), strict=True)
    return AxialColour(measured=tuple(pairs), reference_nm=drawn_nm)


def neglected(
    lens: FittedLens,
    drive: FittedLensDrive,
    *,
    colour: AxialColour,
    weights: np.ndarray,
    nm: np.ndarray,
    height_m: float,
) -> Neglected:
    """Return what pictures mixed from those of one wavelength lack.

    Parameters
    ----------
    lens : FittedLens
        The lens.
    drive : FittedLensDrive
        Its drive.
    colour : AxialColour
        What :func:`lens_colour` says about it.
    weights, nm : ndarray of float64, shape (wavelength,)
        Electrons that the lamp gives at each wavelength (nm).
    height_m : float
        Distance of the picture's corner from its middle, metres.
    """
    low, high = lens.waves_nm
    parts = np.clip(np.round(nm / STEP_NM) * STEP_NM, low, high)
    waves, number = np.unique(parts, return_inverse=True)
    share = np.bincount(number, weights) / weights.sum()
    shifts = colour.shifts(drive, waves, reference_nm=float(waves[0]))
    positions = shifted_positions(drive, MIDDLE, shift=shifts)
    a, fit, drawn = lens_points(drive.aperture_radius_m), lens.fit, colour.reference_nm
    assert drawn is not None  # lens_colour states it
    v, u = float(drive.image_distance(MIDDLE)), float(drive.object_distance(MIDDLE))
    off = np.zeros((len(HEIGHTS), waves.size, 2))
    for n, (wave, shift, position) in enumerate(zip(waves, shifts, positions, strict=True)):
        depth = 1 / (1 / u + shift)
        for k, part in enumerate(HEIGHTS):
            met = []
            for light, at in ((wave, MIDDLE), (drawn, position)):
                seen = fit.at(float(light)).seen_from(depth, float(drive.image_distance(at)))
                x = part * height_m
                w = seen.slope(a, (x, 0.0))
                inside = 1 / depth - 1 / float(drive.object_distance(at))
                met.append([inside * a[0] - x / seen.image_distance_m + w[0], inside * a[1] + w[1]])
            apart = v * (np.array(met[0]) - np.array(met[1]))
            middle = apart.mean(axis=1)
            off[k, n] = np.hypot(*middle) ** 2, ((apart - middle[:, None]) ** 2).sum(axis=0).mean()
    largest = np.sqrt(np.einsum("n,knc->kc", share, off).max(axis=0))
    return Neglected(float(largest[0]), float(largest[1]))
