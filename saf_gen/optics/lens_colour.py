"""The colour of a lens read from a file: its axial colour, and what pictures mixed from those of one wavelength lack.

The polynomials of a lens know its rays at every wavelength. In focus on the axis, at the middle of the travel, is for
light λ the plane whose rays have least squared slopes: if w(a) is what aberrations add to the slope of the ray through
a, then 1/u changes by δ(λ) = -Σ a·(w_λ - w_0)/Σ a² over the aperture. Pictures in light λ are those of the position
that δ names (:mod:`saf_gen.optics.axial_colour`). What is left are rays of λ that land beside those pictures: all of a
point's rays together, which is lateral colour and the scale of a moved lens, and each beside their mean, which is
spherochromatism and its kin off the axis. Both are measured here, ray by ray.

A scene may be rendered in light of several wavelengths, the middles of equal parts of the wavelengths for which the
lens is fitted. They depend on neither lamp nor sensor, so that a new one costs no rendering: in these parts is nearly
all light of the lamps that come with saf_gen, as a sensor behind an IR cut sees it. Light between two of them is drawn
by both, in shares linear in its wavelength (:func:`hats`). The middles of their rays are then where the light lands,
but for what bends between the two; that there are two of them adds to the blur.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from saf_gen.optics.axial_colour import AxialColour, shifted_positions
from saf_gen.optics.fitted_file import FittedLens
from saf_gen.optics.fitted_lens_drive import FittedLensDrive
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


def band_waves(lens: FittedLens, count: int) -> tuple[float, ...]:
    """Return ``count`` wavelengths (nm) at which to render through a lens, the one nearest to its primary one first."""
    low, high = lens.waves_nm
    waves = low + (high - low) * (np.arange(count) + 0.5) / count
    order = np.argsort(np.abs(waves - lens.primary_nm), kind="stable")
    return tuple(np.round(waves[order], 3).tolist())


def hats(nm: np.ndarray, waves_nm: Sequence[float]) -> np.ndarray:
    """Return the share of light of each wavelength that is drawn at each of ``waves_nm``, float64 (band, wavelength).

    Shares of a wavelength add up to 1. Beyond the first and the last, all is drawn at that one; without any of them, at
    a single wavelength.
    """
    if len(waves_nm) < 2:
        return np.ones((1, len(nm)))
    order = np.argsort(waves_nm)
    known = np.array(waves_nm)[order]
    return np.stack([np.interp(nm, known, order == band) for band in range(len(known))])


def lens_colour(lens: FittedLens, drive: FittedLensDrive, *, drawn_nm: float) -> AxialColour:
    """Return the axial colour of a lens whose pictures are drawn in light of ``drawn_nm``.

    Beyond the wavelengths for which the lens is fitted, light is taken to focus as at their ends.
    """
    low, high = lens.waves_nm
    waves = np.append(np.arange(low, high - 1e-6, STEP_NM), high)
    a = lens_points(drive.aperture_radius_m)
    v, u = float(drive.image_distance(MIDDLE)), float(drive.object_distance(MIDDLE))
    along, size = [], float((a[0] ** 2 + a[1] ** 2).sum())
    for nm in (drawn_nm, *waves):
        slope = lens.rays_at(float(nm)).seen_from(u, v).slope(a, (0.0, 0.0))
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
    bands_nm: Sequence[float] = (),
) -> Neglected:
    """Return what pictures lack that are mixed from those of one wavelength, or of few.

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
    bands_nm : sequence of float, default ()
        Wavelengths of the pictures; by default that of ``colour``.
    """
    low, high = lens.waves_nm
    parts = np.clip(np.round(nm / STEP_NM) * STEP_NM, low, high)
    waves, number = np.unique(parts, return_inverse=True)
    share = np.bincount(number, weights) / weights.sum()
    assert colour.reference_nm is not None  # lens_colour states it
    drawn, nowhere = tuple(bands_nm) or (colour.reference_nm,), float(waves[0])
    moved = np.array([colour.relative_to(at).shifts(drive, waves, reference_nm=nowhere) for at in drawn])
    a = lens_points(drive.aperture_radius_m)
    v, u = float(drive.image_distance(MIDDLE)), float(drive.object_distance(MIDDLE))
    depths = 1 / (1 / u + colour.shifts(drive, waves, reference_nm=nowhere))

    def met(light: float, position: float, *, depth: float, x: float) -> np.ndarray:
        """Return the slopes of rays of a point, (2, point), that is seen at x by the ray through the middle."""
        seen = lens.rays_at(float(light)).seen_from(depth, float(drive.image_distance(position)))
        w = seen.slope(a, (x, 0.0))
        inside = 1 / depth - 1 / float(drive.object_distance(position))
        return np.array([inside * a[0] - x / seen.image_distance_m + w[0], inside * a[1] + w[1]])

    off = np.zeros((len(HEIGHTS), waves.size, 2))
    for n, of_bands in enumerate(hats(waves, drawn).T):
        near = np.flatnonzero(of_bands).tolist()
        positions = shifted_positions(drive, MIDDLE, shift=moved[:, n])
        for k, part in enumerate(HEIGHTS):
            here = partial(met, depth=float(depths[n]), x=part * height_m)
            real, middle = here(float(waves[n]), MIDDLE), np.zeros(2)
            for band in near:
                apart = v * (real - here(drawn[band], float(positions[band])))
                middle += of_bands[band] * apart.mean(axis=1)
                off[k, n, 1] += of_bands[band] * (apart**2).sum(axis=0).mean()
            off[k, n, 0] = middle @ middle
            off[k, n, 1] -= off[k, n, 0]
    largest = np.sqrt(np.einsum("n,knc->kc", share, off).max(axis=0).clip(0))
    return Neglected(float(largest[0]), float(largest[1]))
