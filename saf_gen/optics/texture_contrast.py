"""The contrast that a lens with aberrations leaves of a stated texture, over defocus.

The power of the texture falls as 1/f², as that of natural scenes does (Field 1987), from MIN_CYCLES to the Nyquist
frequency of the pixels, evenly in all directions. Its squared contrast is

    C² = ∫ |T(f)·S(f)|²/f² d²f

where S is the transfer of a square pixel and T that of the lens: of its waves if a wavelength is given,

    T(f) = 1/(π·R²)·∫ exp(2πi/λ·(W(a + λvf/2) - W(a - λvf/2))) d²a   over points a with both arguments in the aperture,

otherwise of its rays, T(f) = mean of exp(2πi·f·Δ(a)) with Δ = v·∇W. W is the wavefront plus that of defocus,
a²/2·(1/u_o - 1/u).

Light of many wavelengths adds up, so its transfer is the mean of theirs, T(f) = Σ w·T_λ(f) with the weights w of what
the sensor collects. A lens with axial colour has the defocus 1/u_o - 1/u - δ(λ) (:mod:`saf_gen.optics.axial_colour`).

References
----------
D. J. Field, "Relations between the statistics of natural images and the response properties of cortical cells", J. Opt.
Soc. Am. A 4, 2379 (1987), doi:10.1364/JOSAA.4.002379.
H. H. Hopkins, "The frequency response of a defocused optical system", Proc. R. Soc. A 231, 91 (1955),
doi:10.1098/rspa.1955.0158.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from saf_gen.optics.fitted_rays import SeenWavefront
from saf_gen.optics.wavefront import Wavefront

MIN_CYCLES = 1 / 64  # per pixel
FREQUENCIES, DIRECTIONS = 12, 6
LENS_POINTS = 512
COLOUR_KNOTS = 1025
FINER = 16  # steps within a step of a curve, between which it is taken to be straight
STEP = 0.25  # between the defoci of a curve, in half depths of focus
REACH = 5.0  # half depths of focus beyond the aberrations that a curve covers


class Imaging(NamedTuple):
    """What light passes on its way to a pixel.

    Attributes
    ----------
    radius_m, image_distance_m : float
        Radius R of the aperture, and distance v from the lens to the sensor, metres.
    pitch_m : float
        Pitch of the pixels, metres.
    wavelength_m : float
        Wavelength of the light, metres; 0 for geometric optics.
    """

    radius_m: float
    image_distance_m: float
    pitch_m: float
    wavelength_m: float

    @property
    def resolved_defocus(self) -> float:
        """Defocus (1/m) that blurs a point over the width that the camera resolves: half a depth of focus."""
        width = np.hypot(self.pitch_m, self.wavelength_m * self.image_distance_m / self.radius_m)
        return float(width) / (2 * self.radius_m * self.image_distance_m)


class Light(NamedTuple):
    """The light of one lamp through a lens with axial colour, as a sensor collects it.

    Attributes
    ----------
    shifts : tuple of float
        Power δ of the lens for each part of the light, less that at the wavelength of the stack, 1/m.
    weights : tuple of float
        Fraction of the electrons that each part gives; together 1.
    """

    shifts: tuple[float, ...]
    weights: tuple[float, ...]

    @property
    def mean_shift(self) -> float:
        """Mean of δ, 1/m."""
        return float(np.dot(self.shifts, self.weights))


Blend = tuple[tuple[float, Light], ...]
"""Fractions of the electrons that lamps give, together 1, and the light of each; empty for light of one wavelength."""


@dataclass(frozen=True, eq=False)
class ContrastCurve:
    """Squared contrast over defocus at one distance from the middle of the sensor.

    Attributes
    ----------
    defocus : ndarray of float64, shape (defocus,)
        1/u_o - 1/u, 1/m, evenly spaced.
    squared : ndarray of float64, shape (defocus,)
        Squared contrast.
    balanced : float
        Defocus (1/m) of the least mean squared blur.
    left : float, default 0.0
        Defocus (1/m) that gives a perfect lens the mean squared blur that is left there.
    """

    defocus: np.ndarray
    squared: np.ndarray
    balanced: float
    left: float = 0.0

    def at(self, defocus: np.ndarray) -> np.ndarray:
        """Return the squared contrast at any defocus (1/m); beyond the ends, that of the ends."""
        return np.asarray(self._spline(np.clip(defocus, self.defocus[0], self.defocus[-1])))

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import CubicSpline  # takes half a second and is needed for aberrations only

        return CubicSpline(self.defocus, self.squared)

    @property
    def peak(self) -> float:
        """Defocus (1/m) of the largest contrast, by the parabola through the largest value and its neighbours."""
        k = min(max(int(self.squared.argmax()), 1), self.squared.size - 2)
        before, at, after = self.squared[k - 1 : k + 2]
        step = self.defocus[1] - self.defocus[0]
        return float(self.defocus[k] + step * (before - after) / (2 * (before - 2 * at + after)))

    def reach(self, share: float) -> tuple[float, float]:
        """Return how far from the peak (1/m), below and above, this share of the largest squared contrast is left.

        It is infinite if the curve ends before.
        """
        fine = np.linspace(self.defocus[0], self.defocus[-1], FINER * (self.defocus.size - 1) + 1)
        squared = self.at(fine)
        top = int(squared.argmax())
        left = squared / (share * squared[top])
        found = []
        for side in (slice(top, None, -1), slice(top, None)):
            away, falling = np.abs(fine[side] - self.peak), left[side]
            k = int((falling < 1).argmax())
            found.append(float(np.interp(1, falling[[k, k - 1]], away[[k, k - 1]])) if k else np.inf)
        return found[0], found[1]


@lru_cache(maxsize=256)
def contrast_curve(
    wavefront: Wavefront | SeenWavefront | None, imaging: Imaging, *, height_m: float, blend: Blend = ()
) -> ContrastCurve:
    """Return the contrast over every defocus that the wavefront may balance, and what is near them.

    Parameters
    ----------
    wavefront : Wavefront or None
        Aberrations of the lens; None for a perfect lens.
    imaging : Imaging
        What else light passes.
    height_m : float
        Distance from the middle of the sensor, metres.
    blend : tuple, default ()
        The light; by default of the wavelength of the stack alone.
    """
    rays = _rays(wavefront, imaging, height_m=height_m)
    balanced = rays.balanced
    step = STEP * imaging.resolved_defocus
    if not blend:
        count = int(np.ceil((REACH + rays.spread) / STEP))
        defocus = balanced + np.arange(-count, count + 1) * step
        squared = squared_contrast(defocus, wavefront, imaging=imaging, height_m=height_m)
        return ContrastCurve(defocus, squared, balanced, float(np.sqrt(rays.left)))
    # Light adds up, so transfers do: each lamp's is found once, on one grid for every share of the lamps.
    parts = [  # of the light: share, and power of the lens beyond that at the wavelength of the stack
        (share * weight, shift)
        for share, light in blend
        for shift, weight in zip(light.shifts, light.weights, strict=True)
    ]
    reach = (REACH + rays.spread) * imaging.resolved_defocus
    low = int(np.floor((min(shift for _, shift in parts) - reach) / step))
    high = int(np.ceil((max(shift for _, shift in parts) + reach) / step))
    lamps = [
        (share, _transfer(light, (low, high), wavefront=wavefront, imaging=imaging, height_m=height_m))
        for share, light in blend
        if share > 0
    ]
    total = sum(share * found for share, found in lamps)
    squared = (np.abs(total) ** 2) @ _texture(imaging.pitch_m)
    mean_shift = sum(share * light.mean_shift for share, light in blend)
    left = rays.left + sum(share * (shift - mean_shift) ** 2 for share, shift in parts)
    return ContrastCurve(
        balanced + np.arange(low, high + 1) * step, squared, balanced + mean_shift, float(np.sqrt(left))
    )


class _Rays(NamedTuple):
    """What rays say about a wavefront: the defocus (1/m) of its least blur, the blur² left there as (1/m)², and how
    many half depths of focus from there any part of the lens focuses at most.
    """

    balanced: float = 0.0
    left: float = 0.0
    spread: float = 0.0


def _rays(wavefront: Wavefront | SeenWavefront | None, imaging: Imaging, *, height_m: float) -> _Rays:
    if wavefront is None:
        return _Rays()
    radius = imaging.radius_m
    a = lens_points(radius)
    slope = wavefront.slope(a, (height_m, 0.0))
    balanced = -2 * float(np.mean(a[0] * slope[0] + a[1] * slope[1])) / radius**2
    # Blur is the scatter of the slopes; a defocus of 1/m alone has the mean square radius²/2.
    left = max(2 * float(np.var(slope, axis=1).sum()) / radius**2 - balanced**2, 0.0)
    spread = 4 * wavefront.largest_path(radius, height_m) / radius**2 / imaging.resolved_defocus
    return _Rays(balanced, left, spread)


def _waves(pitch_m: float) -> list[tuple[float, float]]:
    """Return the spatial frequencies (1/m) of the texture along x and y."""
    edges = np.geomspace(MIN_CYCLES, 0.5, FREQUENCIES + 1)
    cycles = np.sqrt(edges[1:] * edges[:-1]) / pitch_m
    angles = (np.arange(DIRECTIONS) + 0.5) * np.pi / DIRECTIONS
    return [(f * np.cos(angle), f * np.sin(angle)) for angle in angles for f in cycles]


def _texture(pitch_m: float) -> np.ndarray:
    """Return the share of each frequency in the squared contrast that the pixels leave, float64 (frequency,)."""
    pixel = np.array([np.sinc(fx * pitch_m) * np.sinc(fy * pitch_m) for fx, fy in _waves(pitch_m)]) ** 2
    return np.asarray(pixel / pixel.sum())


@lru_cache(maxsize=256)
def _transfer(
    light: Light,
    steps: tuple[int, int],
    *,
    wavefront: Wavefront | SeenWavefront | None,
    imaging: Imaging,
    height_m: float,
) -> np.ndarray:
    """Return the transfer of a lamp's light, complex64 (defocus, frequency).

    The defocus is that which the wavefront balances, plus the first to the last of ``steps``. What it adds to the phase
    at a point of the lens is common to all wavelengths, so that colour is one factor for each point.
    """
    step = STEP * imaging.resolved_defocus
    count = steps[1] + 1 - steps[0]
    shifts, weights = np.array(light.shifts), np.array(light.weights)
    balanced = _rays(wavefront, imaging, height_m=height_m).balanced
    waves = _waves(imaging.pitch_m)
    if wavefront is None:
        waves = waves[:FREQUENCIES]  # a perfect lens is the same in all directions
    largest = 2 * np.pi * imaging.image_distance_m * imaging.radius_m * max(np.hypot(*wave) for wave in waves)
    knots = np.linspace(-largest, largest, COLOUR_KNOTS)  # of the phase for a defocus of 1/m, at any frequency
    colour = np.exp(-1j * np.outer(knots, shifts)) @ weights
    found = np.empty((count, len(waves)), np.complex64)
    for n, (fx, fy) in enumerate(waves):
        by_defocus, by_waves = _phases(fx, fy, wavefront=wavefront, imaging=imaging, height_m=height_m)
        each = np.interp(by_defocus, knots, colour.real) + 1j * np.interp(by_defocus, knots, colour.imag)
        each = each * np.exp(1j * (by_waves + (balanced + steps[0] * step) * by_defocus))
        turns = np.broadcast_to(np.exp(1j * step * by_defocus), (count, each.size)).copy()
        turns[0] = each
        found[:, n] = np.multiply.accumulate(turns).sum(axis=1)  # of one step of the defocus more in each row
    return np.tile(found, FREQUENCIES * DIRECTIONS // len(waves)) / LENS_POINTS


def _phases(
    fx: float, fy: float, *, wavefront: Wavefront | SeenWavefront | None, imaging: Imaging, height_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return, for points of the lens that pass a frequency (1/m), its phase for a defocus of 1/m and by the wavefront.

    Both are float64 (point,).
    """
    radius, v, _, wavelength = imaging
    a, point = lens_points(radius), (height_m, 0.0)
    by_defocus = 2 * np.pi * v * (a[0] * fx + a[1] * fy)
    if not wavelength:
        if wavefront is None:
            return by_defocus, np.zeros_like(by_defocus)
        slope = wavefront.slope(a, point)
        return by_defocus, 2 * np.pi * v * (slope[0] * fx + slope[1] * fy)
    sx, sy = wavelength * v * fx / 2, wavelength * v * fy / 2
    ahead, behind = (a[0] + sx, a[1] + sy), (a[0] - sx, a[1] - sy)
    both = np.maximum(np.hypot(*ahead), np.hypot(*behind)) <= radius
    if wavefront is None:
        return by_defocus[both], np.zeros(int(both.sum()))
    path = wavefront.path(ahead, point) - wavefront.path(behind, point)
    return by_defocus[both], 2 * np.pi / wavelength * path[both]


def squared_contrast(
    defocus: np.ndarray, wavefront: Wavefront | SeenWavefront | None, *, imaging: Imaging, height_m: float = 0.0
) -> np.ndarray:
    """Return the squared contrast of the stated texture, divided by that of a perfect lens in focus without waves.

    Parameters
    ----------
    defocus : ndarray of float64, shape (defocus,)
        1/u_o - 1/u, 1/m.
    wavefront, imaging, height_m
        See :func:`contrast_curve`.

    Returns
    -------
    ndarray of float64, shape (defocus,)
        Without unit, from 0 to about 1.
    """
    pitch = imaging.pitch_m
    amount = np.asarray(defocus, np.float32)[:, None]
    total, full = np.zeros(len(defocus)), 0.0
    for fx, fy in _waves(pitch):
        pixel = float(np.sinc(fx * pitch) * np.sinc(fy * pitch)) ** 2
        full += pixel
        by_defocus, by_waves = _phases(fx, fy, wavefront=wavefront, imaging=imaging, height_m=height_m)
        phase = amount * by_defocus.astype(np.float32) + by_waves.astype(np.float32)
        total += pixel * (np.cos(phase).sum(axis=1) ** 2 + np.sin(phase).sum(axis=1) ** 2)
    return total.astype(np.float64) / (full * LENS_POINTS**2)


def lens_points(radius_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return points (m) spread evenly over a disc: a spiral whose turns are the golden angle."""
    n = np.arange(LENS_POINTS) + 0.5
    r, angle = radius_m * np.sqrt(n / LENS_POINTS), n * np.pi * (3 - np.sqrt(5))
    return r * np.cos(angle), r * np.sin(angle)
