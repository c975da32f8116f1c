"""Polynomials fitted to the rays of a lens, how far they are from the rays, and the file of both.

Rays are traced from the sensor through the exit pupil to the scene, evenly over the aperture, the picture, the
wavelengths and the sensor's distances. Coefficients are polynomials of the wavelength, in (λ0/λ)² - 1, because
refractive indices are nearly linear in 1/λ². The residual is that of other rays than the fitted ones.
"""

from typing import NamedTuple

import numpy as np

from saf_gen.addons.lens_files.prescription import Prescription
from saf_gen.addons.lens_files.pupils import find_pupils
from saf_gen.addons.lens_files.trace import Rays, trace_back
from saf_gen.core import seeds
from saf_gen.errors import BadInput
from saf_gen.optics.fitted_file import FittedLens
from saf_gen.optics.fitted_rays import monomials, powers

RAYS = 1000  # of each wavelength and distance
WAVES, COLOUR_ORDER = 7, 3
DISTANCES = 5
PUPIL_MARGIN = 1.3  # of the radius: pupils of the edge of the picture are shifted and deformed
NEAREST = 10.0  # focal lengths: the default distance of the nearest object in focus
DEGREES = (3, 5, 7, 9, 11, 13)
MARK = "# A lens fitted by saf-gen lens fit"
DIGITS = 10  # of a coefficient, of which the largest is about 1


class Reach(NamedTuple):
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


def image_distances(lens: FittedLens) -> np.ndarray:
    """Return V, mm, of the focus on five distances from infinity to the nearest, evenly in V."""
    return np.linspace(lens.focal_length_mm, lens.image_distance_mm(1e3 * lens.nearest_m), DISTANCES)


def traced_rays(
    made: Prescription, lens: FittedLens, *, a: np.ndarray, x: np.ndarray, image_distance_mm: float, wave_nm: float
) -> Rays:
    """Return the rays in the plane of the entrance pupil, z towards the scene, of points (mm) of lens and sensor.

    ``a`` are points of the exit pupil divided by the pupils' magnification. Rays that do not pass the lens are nan.
    """
    m = lens.pupil_magnification
    behind = Rays(m * a, (a - x / m) / image_distance_mm)
    return trace_back(made, behind.at(lens.exit_pupil_mm), wavelength_nm=wave_nm)[0].at(-lens.entrance_pupil_mm)


def sample_rays(lens: FittedLens, count: int, *, stream: str) -> tuple[np.ndarray, np.ndarray]:
    """Return random points a of the lens and x of the sensor, mm, float64 (2, ray); some are at the very edges."""
    generator = seeds.make_generator("lens fit", stream)
    points = []
    for radius in (lens.radius_mm, lens.height_mm):
        angle = 2 * np.pi * generator.random(count)
        r = radius * np.minimum(np.sqrt(1.15 * generator.random(count)), 1)
        points.append(r * np.stack([np.cos(angle), np.sin(angle)]))
    return points[0], points[1]


def fit_lens(made: Prescription, reach: Reach, *, degree: int = 9, source: str = "", made_with: str = "") -> FittedLens:
    """Return the lens whose polynomials are fitted to the rays through the surfaces of a prescription.

    Parameters
    ----------
    made : Prescription
        Surfaces of the lens.
    reach : Reach
        What the polynomials are to cover.
    degree : int, default 9
        Degree in which rays are polynomials of the points of lens and sensor: odd, 3 to 13.
    source, made_with : str, default ""
        Name of the lens file, and the command, for the file of the fitted lens.

    Raises
    ------
    BadInput
        If not all rays pass the lens, or a glass is not known at the wavelengths.
    """
    if degree not in DEGREES:
        raise BadInput(
            f"--degree is {degree}", allowed=f"one of {', '.join(map(str, DEGREES))}: round lenses have no other"
        )
    order, pupils = (degree - 1) // 2, find_pupils(made, made.primary_nm)
    low, high = reach.waves_nm
    waves = np.unique(np.round(1 / np.sqrt(np.linspace(1 / high**2, 1 / low**2, WAVES)), 9))
    colours = min(COLOUR_ORDER, waves.size - 1) + 1
    nothing = ((0.0,) * (2 * len(monomials(order))),) * colours
    lens = FittedLens(
        name=made.name,
        source=source,
        made_with=made_with,
        notes=made.notes,
        focal_length_mm=pupils.focal_length_mm,
        pupil_magnification=pupils.magnification,
        entrance_pupil_mm=pupils.entrance_mm,
        exit_pupil_mm=pupils.exit_mm,
        f_number=pupils.focal_length_mm / (2 * reach.radius_mm),
        height_mm=reach.height_mm,
        nearest_m=reach.nearest_mm / 1e3,
        waves_nm=reach.waves_nm,
        primary_nm=made.primary_nm,
        rms_um=0.0,
        worst_um=0.0,
        degree=degree,
        starts=nothing,
        slopes=nothing,
    )
    f, m, radius, scale = lens.focal_length_mm, lens.pupil_magnification, lens.radius_mm, lens.largest_slope
    a, x = sample_rays(lens, RAYS, stream="fitted")
    by_wave: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for wave in waves:
        columns, starts, slopes = [], [], []
        for v in image_distances(lens):
            rays = traced_rays(made, lens, a=a, x=x, image_distance_mm=v, wave_nm=float(wave))
            _check_pass(rays, lens, a=a, x=x)
            slope = (a - x / m) / v
            alpha, beta = a / radius, (slope - a / f) / scale
            invariants = (alpha**2).sum(0), (alpha * beta).sum(0), (beta**2).sum(0)
            terms = np.stack([np.broadcast_to(term, RAYS) for term in powers(order, invariants)])
            columns.append(np.concatenate([np.concatenate([terms * alpha[n], terms * beta[n]]).T for n in (0, 1)]))
            starts.append(((rays.place - a) / radius).ravel())
            slopes.append(((rays.slope - m * (slope - a / f)) / scale).ravel())
        both = np.stack([np.concatenate(starts), np.concatenate(slopes)], axis=1)
        solution = np.linalg.lstsq(np.concatenate(columns), both, rcond=1e-13)[0]
        for found, values in zip(by_wave, solution.T, strict=True):
            found.append(values)
    colour = ((made.primary_nm / waves) ** 2 - 1)[:, None] ** np.arange(colours)
    solved = [np.linalg.lstsq(colour, np.stack(found), rcond=None)[0].tolist() for found in by_wave]
    starts_of, slopes_of = (tuple(map(tuple, rows)) for rows in solved)
    lens = lens.model_copy(update={"starts": starts_of, "slopes": slopes_of})
    off = residuals_um(lens, made)
    errors = {"rms_um": float(np.sqrt((off**2).mean())), "worst_um": float(off.max())}
    return lens.model_copy(update={**errors, "relative_illumination": relative_illumination(lens, made)})


def residuals_um(lens: FittedLens, made: Prescription, *, count: int = 2000) -> np.ndarray:
    """Return how far fitted rays are from traced ones, µm on the sensor, float64 (wave, distance, ray).

    A ray is off by the distance between both in the plane in focus, divided by the size of a micrometre of the picture
    there. Wavelengths lie between those that were fitted.
    """
    low, high = lens.waves_nm
    a, x = sample_rays(lens, count, stream="compared")
    m, f = lens.pupil_magnification, lens.focal_length_mm
    found = []
    for wave in np.linspace(low, high, 4):
        rays = lens.rays_at(float(wave))
        for v in image_distances(lens):
            traced = traced_rays(made, lens, a=a, x=x, image_distance_mm=v, wave_nm=float(wave))
            moved, turned = rays.turn(tuple(a / 1e3), tuple(x / 1e3), image_distance_m=v / 1e3)
            place = traced.place - a - 1e3 * np.stack(moved)
            slope = traced.slope - m * ((a - x / m) / v - a / f) - np.stack(turned)
            off = v * (slope + place * m * (1 / f - 1 / v))
            found.append(1e3 * np.hypot(*off))
    return np.stack(found).reshape(4, DISTANCES, count)


def relative_illumination(lens: FittedLens, made: Prescription, *, heights: int = 9) -> tuple[tuple[float, float], ...]:
    """Return image heights (mm) and the light there relative to the middle, with the sensor in focus at infinity.

    Light comes through all of the exit pupil whose rays pass the stop and the clear parts of all surfaces, weakened by
    the fourth power of the cosine of their angle to the axis.
    """
    m, f, r = lens.pupil_magnification, lens.focal_length_mm, lens.radius_mm
    limits = np.array([one.semi_diameter_mm for one in made.surfaces])
    limits[made.stop] = r * abs(find_pupils(made, made.primary_nm).stop_scale)
    across = np.linspace(-PUPIL_MARGIN, PUPIL_MARGIN, 101) * r
    a, found = np.stack(np.meshgrid(across, across)).reshape(2, -1), []
    for height in np.linspace(0, lens.height_mm, heights):
        behind = Rays(m * a, (a - np.array([[0.0], [height]]) / m) / f)
        rays, met = trace_back(made, behind.at(lens.exit_pupil_mm), wavelength_nm=made.primary_nm)
        with np.errstate(invalid="ignore"):
            passes = (met <= limits[:, None] * (1 + 1e-9)).all(axis=0) & np.isfinite(rays.place[0])
        found.append((float(height), float((passes / (1 + (behind.slope**2).sum(axis=0)) ** 2).sum())))
    return tuple((height, light / found[0][1]) for height, light in found)


def fitted_text(lens: FittedLens) -> str:
    """Return the text of the file of a fitted lens."""
    lines = [f"{MARK}: {lens.made_with}"]
    for key, value in lens.model_dump().items():
        if key in ("starts", "slopes"):
            rows = [", ".join(f"{number:.{DIGITS}g}" for number in row) for row in value]
            lines += [f"{key}:", *(f"- [{row}]" for row in rows)]
        elif key == "relative_illumination":
            lines.append(f"{key}: [{', '.join(f'[{h:.4g}, {part:.4g}]' for h, part in value)}]")
        elif isinstance(value, tuple):
            lines.append(f"{key}: [{', '.join(map(_plain, value))}]")
        else:
            lines.append(f"{key}: {_plain(value)}")
    return "\n".join(lines) + "\n"


def _plain(value: object) -> str:
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def _check_pass(rays: Rays, lens: FittedLens, *, a: np.ndarray, x: np.ndarray) -> None:
    lost = ~np.isfinite(rays.place[0] + rays.slope[0])
    if lost.any():
        share = np.hypot(*a[:, lost]).min() / lens.radius_mm
        height = np.hypot(*x[:, lost]).min()
        raise BadInput(
            f"{lens.name}: {lost.mean():.1%} of the rays do not pass, from {share:.0%} of the aperture's radius and "
            f"{height:.3g} mm of image height on",
            allowed="an aperture and a picture whose rays all meet every surface",
            hint="a higher --f-number, or a lower --height-mm",
        )
