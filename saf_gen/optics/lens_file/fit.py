"""Polynomials fitted to the rays of a lens, and how far they are from the rays.

Rays are traced from the sensor through the exit pupil to the scene, evenly over the aperture, the picture, the
wavelengths and the sensor's distances. Coefficients are polynomials of the wavelength, in (λ0/λ)² - 1, because
refractive indices are nearly linear in 1/λ². The residual is that of other rays than the fitted ones.
"""

from dataclasses import dataclass, replace

import numpy as np

from saf_gen.core import seeds
from saf_gen.errors import BadInput
from saf_gen.optics.fitted_rays import FittedRays, monomials, powers
from saf_gen.optics.lens_file.prescription import Prescription
from saf_gen.optics.lens_file.pupils import Pupils, find_pupils
from saf_gen.optics.lens_file.trace import Rays, trace_back

RAYS = 1000  # of each wavelength and distance
WAVES, COLOUR_ORDER = 7, 3
DISTANCES = 5
PUPIL_MARGIN = 1.3  # of the radius: pupils of the edge of the picture are shifted and deformed
NEAREST = 10.0  # focal lengths: the default distance of the nearest object in focus
DEGREES = (3, 5, 7, 9, 11, 13)


@dataclass(frozen=True)
class Reach:
    """What the polynomials are to cover.

    Attributes
    ----------
    radius_mm : float
        Radius of the entrance pupil, mm.
    height_mm : float
        Distance from the middle of the sensor, mm.
    nearest_mm : float
        Distance of the nearest object in focus from the entrance pupil, mm; the farthest is at infinity.
    waves_nm : tuple of float
        Shortest and longest wavelength, nm.
    """

    radius_mm: float
    height_mm: float
    nearest_mm: float
    waves_nm: tuple[float, float]


@dataclass(frozen=True)
class LensFit:
    """A fitted lens.

    Attributes
    ----------
    pupils : Pupils
        What the lens does near its axis, at the primary wavelength.
    reach : Reach
        What the polynomials cover.
    primary_nm : float
        Primary wavelength λ0, nm.
    order : int
        Order of the polynomials (:class:`saf_gen.optics.fitted_rays.FittedRays`).
    starts, slopes : ndarray of float64, shape (colour, coefficient)
        Coefficients of each power of (λ0/λ)² - 1.
    rms_um, worst_um : float
        Distance on the sensor, µm, between traced rays and fitted ones: root of the mean square, and the largest.
    """

    pupils: Pupils
    reach: Reach
    primary_nm: float
    order: int
    starts: np.ndarray
    slopes: np.ndarray
    rms_um: float = np.nan
    worst_um: float = np.nan

    def at(self, wave_nm: float) -> FittedRays:
        """Return the polynomials at one wavelength (nm); raise BadInput outside those that were fitted."""
        low, high = self.reach.waves_nm
        if not low - 1e-6 <= wave_nm <= high + 1e-6:
            raise BadInput(f"the lens is fitted for other light than {wave_nm:g} nm", allowed=f"{low:g} to {high:g} nm")
        colour = ((self.primary_nm / wave_nm) ** 2 - 1) ** np.arange(len(self.starts))
        return FittedRays(
            focal_length_m=self.pupils.focal_length_mm / 1e3,
            pupil_magnification=self.pupils.magnification,
            radius_m=self.reach.radius_mm / 1e3,
            height_m=self.reach.height_mm / 1e3,
            slope=largest_slope(self.pupils, self.reach),
            order=self.order,
            starts=tuple(map(float, colour @ self.starts)),
            slopes=tuple(map(float, colour @ self.slopes)),
        )


def find_reach(
    lens: Prescription,
    *,
    f_number: float | None = None,
    height_mm: float | None = None,
    nearest_m: float | None = None,
    waves_nm: tuple[float, float] | None = None,
) -> Reach:
    """Return what the polynomials are to cover: what is given, and otherwise what the prescription says.

    Raises
    ------
    BadInput
        If a number is not above 0, or the nearest object is within four focal lengths.
    """
    pupils = find_pupils(lens, lens.primary_nm)
    f = pupils.focal_length_mm
    for value, what in ((f_number, "--f-number"), (height_mm, "--height-mm"), (nearest_m, "--nearest-m")):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise BadInput(f"{what} is {value:g}", allowed="a number above 0")
    nearest_mm = NEAREST * f if nearest_m is None else 1e3 * nearest_m
    if nearest_mm < 4 * f / pupils.magnification:
        raise BadInput(
            f"--nearest-m is {nearest_mm / 1e3:g}",
            allowed=f"at least four focal lengths from the entrance pupil, {4e-3 * f / pupils.magnification:.3g} m",
        )
    kind, field = lens.field
    in_file = field if kind == "image" else f * np.tan(np.radians(field))
    radius = f / (2 * f_number) if f_number else pupils.entrance_radius_mm(lens.aperture)
    return Reach(radius, height_mm or float(in_file), nearest_mm, waves_nm or (lens.waves_nm[0], lens.waves_nm[-1]))


def largest_slope(pupils: Pupils, reach: Reach) -> float:
    """Return the largest slope behind the lens less a/f, over the reach: the scale of the polynomials."""
    near, far = image_distances(pupils, reach)[[-1, 0]]
    return float(reach.height_mm / (pupils.magnification * far) + reach.radius_mm * (1 / far - 1 / near))


def image_distances(pupils: Pupils, reach: Reach) -> np.ndarray:
    """Return V, mm, of the focus on five distances from infinity to the nearest, evenly in V."""
    f = pupils.focal_length_mm
    return np.linspace(f, 1 / (1 / f - 1 / (pupils.magnification * reach.nearest_mm)), DISTANCES)


def traced_rays(
    lens: Prescription, pupils: Pupils, *, a: np.ndarray, x: np.ndarray, image_distance_mm: float, wave_nm: float
) -> Rays:
    """Return the rays in the plane of the entrance pupil, z towards the scene, of points (mm) of lens and sensor.

    ``a`` are points of the exit pupil divided by the pupils' magnification. Rays that do not pass the lens are nan.
    """
    m = pupils.magnification
    behind = Rays(m * a, (a - x / m) / image_distance_mm)
    return trace_back(lens, behind.at(pupils.exit_mm), wavelength_nm=wave_nm)[0].at(-pupils.entrance_mm)


def sample_rays(reach: Reach, count: int, *, stream: str) -> tuple[np.ndarray, np.ndarray]:
    """Return random points a of the lens and x of the sensor, mm, float64 (2, ray); some are at the very edges."""
    generator = seeds.make_generator("lens fit", stream)
    points = []
    for radius in (reach.radius_mm, reach.height_mm):
        angle = 2 * np.pi * generator.random(count)
        r = radius * np.minimum(np.sqrt(1.15 * generator.random(count)), 1)
        points.append(r * np.stack([np.cos(angle), np.sin(angle)]))
    return points[0], points[1]


def fit_lens(lens: Prescription, reach: Reach, *, degree: int = 9) -> LensFit:
    """Fit polynomials to the rays of a lens.

    Parameters
    ----------
    lens : Prescription
        Surfaces of the lens.
    reach : Reach
        What the polynomials are to cover.
    degree : int, default 9
        Degree in which rays are polynomials of the points of lens and sensor: odd, 3 to 13.

    Raises
    ------
    BadInput
        If not all rays pass the lens, or a glass is not known at the wavelengths.
    """
    if degree not in DEGREES:
        raise BadInput(
            f"--degree is {degree}", allowed=f"one of {', '.join(map(str, DEGREES))}: round lenses have no other"
        )
    order, pupils = (degree - 1) // 2, find_pupils(lens, lens.primary_nm)
    low, high = reach.waves_nm
    waves = np.unique(np.round(1 / np.sqrt(np.linspace(1 / high**2, 1 / low**2, WAVES)), 9))
    colours = min(COLOUR_ORDER, waves.size - 1) + 1
    nothing = np.zeros((colours, 2 * len(monomials(order))))
    fit = LensFit(pupils, reach, lens.primary_nm, order, nothing, nothing)
    f, m = pupils.focal_length_mm, pupils.magnification
    a, x = sample_rays(reach, RAYS, stream="fitted")
    distances, scale = image_distances(pupils, reach), largest_slope(pupils, reach)
    by_wave: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for wave in waves:
        columns, starts, slopes = [], [], []
        for v in distances:
            rays = traced_rays(lens, pupils, a=a, x=x, image_distance_mm=v, wave_nm=float(wave))
            _check_pass(rays, lens, reach=reach, a=a, x=x)
            slope = (a - x / m) / v
            alpha, beta = a / reach.radius_mm, (slope - a / f) / scale
            terms = np.stack(
                [
                    np.broadcast_to(term, RAYS)
                    for term in powers(order, ((alpha**2).sum(0), (alpha * beta).sum(0), (beta**2).sum(0)))
                ]
            )
            columns.append(np.concatenate([np.concatenate([terms * alpha[n], terms * beta[n]]).T for n in (0, 1)]))
            starts.append(((rays.place - a) / reach.radius_mm).ravel())
            slopes.append(((rays.slope - m * (slope - a / f)) / scale).ravel())
        matrix = np.concatenate(columns)
        both = np.stack([np.concatenate(starts), np.concatenate(slopes)], axis=1)
        solution = np.linalg.lstsq(matrix, both, rcond=1e-13)[0]
        for found, values in zip(by_wave, solution.T, strict=True):
            found.append(values)
    colour = ((lens.primary_nm / waves) ** 2 - 1)[:, None] ** np.arange(colours)
    solved = [np.linalg.lstsq(colour, np.stack(found), rcond=None)[0] for found in by_wave]
    fit = replace(fit, starts=solved[0], slopes=solved[1])
    off = residuals_um(fit, lens)
    return replace(fit, rms_um=float(np.sqrt((off**2).mean())), worst_um=float(off.max()))


def residuals_um(fit: LensFit, lens: Prescription, *, count: int = 2000) -> np.ndarray:
    """Return how far fitted rays are from traced ones, µm on the sensor, float64 (wave, distance, ray).

    A ray is off by the distance between both in the plane in focus, divided by the size of a micrometre of the picture
    there. Wavelengths lie between those that were fitted.
    """
    low, high = fit.reach.waves_nm
    a, x = sample_rays(fit.reach, count, stream="compared")
    m, f = fit.pupils.magnification, fit.pupils.focal_length_mm
    found = []
    for wave in np.linspace(low, high, 4):
        rays = fit.at(float(wave))
        for v in image_distances(fit.pupils, fit.reach):
            traced = traced_rays(lens, fit.pupils, a=a, x=x, image_distance_mm=v, wave_nm=float(wave))
            moved, turned = rays.turn(tuple(a / 1e3), tuple(x / 1e3), image_distance_m=v / 1e3)
            place = traced.place - a - 1e3 * np.stack(moved)
            slope = traced.slope - m * ((a - x / m) / v - a / f) - np.stack(turned)
            off = v * (slope + place * m * (1 / f - 1 / v))
            found.append(1e3 * np.hypot(*off))
    return np.stack(found).reshape(4, DISTANCES, count)


def relative_illumination(lens: Prescription, fit: LensFit, *, heights: int = 9) -> tuple[tuple[float, float], ...]:
    """Return image heights (mm) and the light there relative to the middle, with the sensor in focus at infinity.

    Light comes through all of the exit pupil whose rays pass the stop and the clear parts of all surfaces, weakened by
    the fourth power of the cosine of their angle to the axis.
    """
    pupils, r = fit.pupils, fit.reach.radius_mm
    m, f = pupils.magnification, pupils.focal_length_mm
    limits = np.array([one.semi_diameter_mm for one in lens.surfaces])
    limits[lens.stop] = r * abs(find_pupils(lens, lens.primary_nm).stop_scale)
    across = np.linspace(-PUPIL_MARGIN, PUPIL_MARGIN, 101) * r
    a, found = np.stack(np.meshgrid(across, across)).reshape(2, -1), []
    for height in np.linspace(0, fit.reach.height_mm, heights):
        behind = Rays(m * a, (a - np.array([[0.0], [height]]) / m) / f)
        rays, met = trace_back(lens, behind.at(pupils.exit_mm), wavelength_nm=lens.primary_nm)
        with np.errstate(invalid="ignore"):
            passes = (met <= limits[:, None] * (1 + 1e-9)).all(axis=0) & np.isfinite(rays.place[0])
        found.append((float(height), float((passes / (1 + (behind.slope**2).sum(axis=0)) ** 2).sum())))
    return tuple((height, light / found[0][1]) for height, light in found)


def _check_pass(rays: Rays, lens: Prescription, *, reach: Reach, a: np.ndarray, x: np.ndarray) -> None:
    lost = ~np.isfinite(rays.place[0] + rays.slope[0])
    if lost.any():
        share = np.hypot(*a[:, lost]).min() / reach.radius_mm
        height = np.hypot(*x[:, lost]).min()
        raise BadInput(
            f"{lens.name}: {lost.mean():.1%} of the rays do not pass, from {share:.0%} of the aperture's radius and "
            f"{height:.3g} mm of image height on",
            allowed="an aperture and a picture whose rays all meet every surface",
            hint="a higher --f-number, or a lower --height-mm",
        )
