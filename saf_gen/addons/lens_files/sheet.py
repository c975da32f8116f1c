"""Figures of a fitted lens: what it does to a point, and the numbers beside them."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from saf_gen.core.figure_style import COLOURS, STYLE, hide_spines, use_plot_style
from saf_gen.core.files import atomic_file
from saf_gen.optics.fitted_file import FittedLens
from saf_gen.optics.fitted_rays import FittedRays, SeenWavefront
from saf_gen.optics.texture_contrast import lens_points

HEIGHTS = (0.0, 0.7, 1.0)  # of the spots, as parts of the fitted height
STEPS = (-8, -4, 0, 4, 8)  # of the spots, in waves of defocus at the edge of the aperture
SMALL = 0.02  # of the aperture: rays near the axis
USUAL_PITCH_UM = 20.0  # of spike cameras
BELOW: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (0, -0.2), "ncols": 3, "columnspacing": 1}  # of curves


class Aberration(NamedTuple):
    """What a fitted lens does to objects at infinity, with the sensor in the focus of rays near the axis.

    Attributes
    ----------
    spherical_mm : float
        How far behind that focus rays from the edge of the aperture meet the axis, mm.
    tangential_mm, sagittal_mm : float
        How far behind it narrow bundles focus at the fitted height, in the plane of the axis and across it, mm.
    distortion : float
        Displacement at the fitted height divided by it.
    colour_mm : float
        Distance between the foci of the longest and the shortest wavelength, mm.
    """

    spherical_mm: float
    tangential_mm: float
    sagittal_mm: float
    distortion: float
    colour_mm: float


def measure_lens(lens: FittedLens) -> Aberration:
    """Return the aberrations of a fitted lens in numbers."""
    seen, height = _at_infinity(lens.rays_at()), lens.height_mm / 1e3
    tangential, sagittal = _field_foci(seen, np.array([0.0, height]))
    chief = float(seen.slope((np.zeros(1), np.zeros(1)), (height, 0.0))[0][0])
    v = seen.image_distance_m
    near, edge = _axis_focus(seen, np.array([SMALL, 1.0]))
    low, high = (float(_axial_foci(lens, wave)[0]) for wave in lens.waves_nm)
    return Aberration(
        spherical_mm=1e3 * float(edge - near),
        tangential_mm=float(1e3 * (tangential[1] - tangential[0])),
        sagittal_mm=float(1e3 * (sagittal[1] - sagittal[0])),
        distortion=chief * v / (height - chief * v) if height else 0.0,
        colour_mm=1e3 * (high - low),
    )


def _at_infinity(rays: FittedRays) -> SeenWavefront:
    return rays.seen_from(np.inf, rays.focal_length_m)


def _axis_focus(seen: SeenWavefront, zones: np.ndarray) -> np.ndarray:
    """Return how far behind the focus near the axis (m) rays through these parts of the aperture's radius meet it."""
    a = zones * seen.rays.radius_m
    return _moved(seen, seen.slope((a, np.zeros_like(a)), (0.0, 0.0))[0] / a)


def _moved(seen: SeenWavefront, vergence: np.ndarray) -> np.ndarray:
    """Return by how much (m) the sensor moves back for rays whose slope changes by this much per metre of the lens."""
    return np.asarray(seen.image_distance_m**2 * vergence)


def _axial_foci(lens: FittedLens, wave_nm: float) -> np.ndarray:
    return _axis_focus(_at_infinity(lens.rays_at(wave_nm)), np.array([SMALL]))


def _field_foci(seen: SeenWavefront, heights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the tangential and sagittal foci (m behind that of the axis) at distances from the middle (m)."""
    step, zero = SMALL * seen.rays.radius_m * np.ones_like(heights), np.zeros_like(heights)
    found = []
    for n, a in enumerate(((step, zero), (zero, step))):
        ahead, behind = seen.slope(a, (heights, 0.0)), seen.slope((-a[0], -a[1]), (heights, 0.0))
        found.append(_moved(seen, (ahead[n] - behind[n]) / (2 * step)))
    return found[0], found[1]


def draw_lens(lens: FittedLens, path: Path) -> None:
    """Write the figure of a fitted lens as a PNG file.

    It shows spots of points at the middle and towards the edge of the picture over the focus, spherical aberration,
    field curvature, axial colour, and the light at the edge of the picture.
    """
    seen = _at_infinity(lens.rays_at())
    with use_plot_style({**STYLE, "figure.facecolor": "white"}):
        figure = Figure(figsize=(8.8, 6.4), dpi=150, layout="constrained")
        parts: Any = figure.subfigures(2, 1, height_ratios=(1.25, 1))
        top, bottom = parts
        _draw_spots(top.subplots(len(HEIGHTS), len(STEPS)), lens, seen=seen)
        axes = bottom.subplots(1, 4)
        _draw_spherical(axes[0], lens)
        _draw_curvature(axes[1], lens, seen=seen)
        _draw_colour(axes[2], lens)
        _draw_illumination(axes[3], lens)
        seen_at = f"{lens.focal_length_mm:.3g} mm f/{lens.f_number:.3g}, {lens.primary_nm:.0f} nm, object at infinity"
        figure.suptitle(f"{lens.name}, {seen_at}", fontsize=8.5)
        with atomic_file(path) as part:
            figure.savefig(part, format="png", metadata={"Software": None})


def _draw_spots(axes: np.ndarray, lens: FittedLens, *, seen: SeenWavefront) -> None:
    radius, v = seen.rays.radius_m, seen.image_distance_m
    a = lens_points(radius)
    step = 2 * lens.primary_nm * 1e-9 / radius**2  # a wave of defocus at the edge of the aperture
    a_bar = -float(np.mean(a[0] * seen.slope(a, (0.0, 0.0))[0] + a[1] * seen.slope(a, (0.0, 0.0))[1])) * 2 / radius**2
    spots = {}
    for row, part in enumerate(HEIGHTS):
        slope = seen.slope(a, (0.0, part * lens.height_mm / 1e3))
        for column, amount in enumerate(STEPS):
            spot = [v * 1e6 * (s + (a_bar + amount * step) * along) for s, along in zip(slope, a, strict=True)]
            spots[row, column] = [one - one.mean() for one in spot]
    reach = 1.05 * max(float(np.abs(spot).max()) for spot in spots.values())
    for (row, column), (x, y) in spots.items():
        one = axes[row, column]
        one.scatter(x, y, s=0.5, color=COLOURS[0], linewidths=0)
        one.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xticks=[], yticks=[])
        if row == 0:
            one.set_title(f"{-1e6 * v * v * STEPS[column] * step + 0.0:+.0f} µm")
        if column == 0:
            one.set_ylabel(f"{HEIGHTS[row] * lens.height_mm:.3g} mm")
    axes[-1, 0].set_xlabel(f"each box {2 * reach:.3g} µm")


def _draw_spherical(axes: Axes, lens: FittedLens) -> None:
    zones = np.linspace(SMALL, 1, 40)
    for colour, wave in zip(COLOURS, sorted({lens.waves_nm[0], lens.primary_nm, lens.waves_nm[1]}), strict=False):
        focus = _axis_focus(_at_infinity(lens.rays_at(wave)), zones)
        axes.plot(1e3 * focus, zones, color=colour, lw=1.2, label=f"{wave:.0f} nm")
    axes.set(title="spherical aberration", xlabel="focus, mm", ylabel="part of the aperture")
    axes.locator_params(axis="x", nbins=4)
    axes.legend(**BELOW)
    hide_spines(axes, "top", "right")


def _draw_curvature(axes: Axes, lens: FittedLens, *, seen: SeenWavefront) -> None:
    heights = np.linspace(0, lens.height_mm, 40)
    for colour, name, focus in zip(COLOURS, ("tangential", "sagittal"), _field_foci(seen, heights / 1e3), strict=False):
        axes.plot(1e3 * focus, heights, color=colour, lw=1.2, label=name)
    axes.set(title="field curvature", xlabel="focus, mm", ylabel="image height, mm")
    axes.locator_params(axis="x", nbins=4)
    axes.legend(**BELOW)
    hide_spines(axes, "top", "right")


def _draw_colour(axes: Axes, lens: FittedLens) -> None:
    waves = np.linspace(*lens.waves_nm, 30)
    axes.plot(waves, [1e3 * float(_axial_foci(lens, float(wave))[0]) for wave in waves], color=COLOURS[0], lw=1.2)
    axes.set(title="axial colour", xlabel="wavelength, nm", ylabel="focus, mm")
    hide_spines(axes, "top", "right")


def _draw_illumination(axes: Axes, lens: FittedLens) -> None:
    if lens.relative_illumination:
        heights, light = np.array(lens.relative_illumination).T
        axes.plot(heights, light, color=COLOURS[0], lw=1.2)
    axes.set(title="relative illumination", xlabel="image height, mm", ylim=(0, 1.05))
    hide_spines(axes, "top", "right")
