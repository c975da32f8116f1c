"""Camera rays for a one-pass stack, and the point where each meets the sensor at every focus position.

A ray that meets sensor and lens at (x, a) at the middle position meets them at M(p)·(x, a) at position p, where M is
the drive's transfer matrix, linear in p. Rays are spread evenly over sensor and lens, and over a border around both
that is wide enough for every position (:func:`saf_gen.render.ray_sampling.ray_coverage`). M keeps them evenly
spread. If the lens moves through the rays, a path counts only at the positions at which it is inside the aperture. The
paths that fall into a pixel are thus an even sample of pixel and aperture at every position, and their mean is
unbiased. Waves bend a path at the lens, which moves its line across the sensor (:mod:`saf_gen.render.diffraction`).
Aberrations turn it in front of the lens, which moves nothing behind it (:mod:`saf_gen.optics.wavefront`); a lens read
from a file also moves where it starts (:mod:`saf_gen.optics.fitted_rays`). A path that does not pass a ring in front of
the lens counts, and brings no light (:mod:`saf_gen.optics.vignetting`).
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.optics import FittedRays, Wavefront
from saf_gen.render.diffraction import find_waves, place_bends
from saf_gen.render.host_splat import NEVER, TracedPaths
from saf_gen.render.ray_sampling import place_samples, ray_coverage
from saf_gen.render.render_setup import RenderSetup

RAYS_PER_PASS = 1 << 20  # four times as many would take a quarter longer and need half a gibibyte more


class CameraRays(NamedTuple):
    """The rays of one or more bands of rows at the middle of a range of focus positions, as Dr.Jit arrays (ray,).

    Attributes
    ----------
    done : float
        Fraction of the rows that are done after these, 0 to 1.
    bands : tuple of (int, int, int)
        Each band's first row, from which the random numbers of its light paths are derived, and its first ray here and
        the ray after its last.
    first : int
        Number of the first ray here among all rays.
    samples : int
        Rays per pixel; the rays of a pixel are adjacent.
    pixel, sample : UInt32
        Number of the pixel, and of the ray within it.
    x, y : Float
        Point where the ray meets the sensor, in metres from the sensor's middle.
    lens : Point2f
        Point where the ray meets the lens, in metres from the lens's centre.
    slope_x, slope_y : Float
        Slopes of the ray in object space.
    ray : RayDifferential3f
        Ray in world space.
    passes : Bool or None
        Whether the ray passes the ring in front of the lens; None if there is none.
    """

    done: float
    bands: tuple[tuple[int, int, int], ...]
    first: int
    samples: int
    pixel: Any
    sample: Any
    x: Any
    y: Any
    lens: Any
    slope_x: Any
    slope_y: Any
    ray: Any
    passes: Any = None

    @property
    def is_only_band(self) -> bool:
        """Whether one band holds all rays."""
        return self.done >= 1 and self.first == 0 and len(self.bands) == 1


def cast_rays(
    setup: RenderSetup, focus: np.ndarray, *, samples: int, seed: int, at_once: int = 1
) -> Iterator[CameraRays]:
    """Yield the camera rays of ``at_once`` bands of rows in turn, for evenly spaced focus positions (at least two).

    The rays and their order are the same for any number of bands at once.
    """
    drive, grid, units = setup.drive, setup.grid, 1 / setup.unit_m
    middle = float(focus[0] + focus[-1]) / 2
    ends = float(focus[0]), float(focus[-1])
    waves = find_waves(drive, grid, wavelength_m=setup.wavelength_m, ends=ends)
    covered = ray_coverage(drive, grid, ends=ends, bend_reach_m=waves.reach_m if waves else 0.0)
    # At each position, the part of the lens disc that is the aperture still gets the requested samples.
    requested, samples = samples, math.ceil(samples * (covered.radius_m / drive.aperture_radius_m) ** 2 - 1e-9)
    rows, columns = grid.rows + 2 * covered.rows, grid.columns + 2 * covered.columns
    rows_per_pass = max(1, RAYS_PER_PASS // (columns * samples))
    inverse_v, inverse_u = (
        _opaque_reciprocal(distance(middle)) for distance in (drive.image_distance, drive.object_distance)
    )
    # Rays start where the lens is farthest from the scene; trace_geometry() has made sure that no
    # surface is in between.
    farthest = float(drive.shift(focus).min())
    ahead = opaque(farthest - float(drive.shift(middle)))
    farthest, radius = opaque(farthest), opaque(covered.radius_m)
    half_rows, half_columns = opaque(rows / 2), opaque(columns / 2)
    pitch = opaque(grid.pitch_m)
    # Distortion turns a ray by where it meets the sensor halfway, which is the same for every window of positions.
    chief_x, chief_a = map(opaque, drive.ray_transfer(0.5, middle)[0] / float(drive.image_distance(0.5)))
    samples_word, row_length = dr.opaque(mi.UInt32, samples), dr.opaque(mi.UInt32, columns)
    transform = mi.Transform4f(setup.to_world)
    for begin in range(0, rows, at_once * rows_per_pass):
        count = min(at_once * rows_per_pass, rows - begin)
        index = dr.arange(mi.UInt32, count * columns * samples)
        pixel, sample = index // samples_word, index % samples_word
        # The band is traced column by column, so that the pixels to which neighbouring rays add stay in the cache.
        height, top = dr.opaque(mi.UInt32, count), dr.opaque(mi.UInt32, begin)
        if at_once > 1:
            rows_before = pixel // dr.opaque(mi.UInt32, rows_per_pass * columns) * dr.opaque(mi.UInt32, rows_per_pass)
            pixel, top = pixel - rows_before * row_length, top + rows_before
            height = dr.minimum(dr.opaque(mi.UInt32, rows_per_pass), height - rows_before)
        row, column = pixel % height + top, pixel // height
        pixel = row * row_length + column
        across, down, lens = place_samples(pixel, sample, samples=requested, seed=seed)
        x = (mi.Float(column) + across - half_columns) * pitch
        y = (mi.Float(row) + down - half_rows) * pitch
        a = mi.warp.square_to_uniform_disk_concentric(lens) * radius
        # Slope in object space. The equivalent (a - x)/v - a/f would lose digits if u is much larger than f.
        slope_x, slope_y = -(x * inverse_v + a.x * inverse_u), -(y * inverse_v + a.y * inverse_u)
        start = a
        if isinstance(drive.wavefront, FittedRays):
            v = opaque(drive.image_distance(middle))
            moved, bent = drive.wavefront.turn((a.x, a.y), (x, y), image_distance_m=v)
            start, slope_x, slope_y = a + mi.Vector2f(*moved), slope_x + bent[0], slope_y + bent[1]
        elif isinstance(drive.wavefront, Wavefront):
            turned = drive.wavefront.slope((a.x, a.y), (x, y), number=opaque)
            slope_x, slope_y = slope_x + turned[0], slope_y + turned[1]
        if drive.distortion is not None:
            through_centre = -(x * chief_x + a.x * chief_a), -(y * chief_x + a.y * chief_a)
            turned = drive.distortion.turn(through_centre, number=opaque)
            slope_x, slope_y = slope_x + turned[0], slope_y + turned[1]
        origin = mi.Point3f(start.x + slope_x * ahead, start.y + slope_y * ahead, farthest) * units
        ray = mi.RayDifferential3f(transform @ origin, transform @ dr.normalize(mi.Vector3f(slope_x, slope_y, 1)))
        done, first, per_row = (begin + count) / rows, begin * columns * samples, columns * samples
        tops = range(begin, begin + count, rows_per_pass)
        bands = tuple((top, (top - begin) * per_row, min(top - begin + rows_per_pass, count) * per_row) for top in tops)
        passes = None if drive.ring is None else drive.ring.passes((a.x, a.y), (slope_x, slope_y), number=opaque)
        yield CameraRays(done, bands, first, samples, pixel, sample, x, y, a, slope_x, slope_y, ray, passes)


def land_on_sensor(rays: CameraRays, setup: RenderSetup, *, focus: np.ndarray, seed: int) -> TracedPaths:
    """Return the line along which each ray moves across the sensor over the positions, unevaluated, without radiance.

    ``focus`` and ``seed`` must be the arguments of :func:`cast_rays`.
    """
    drive, grid = setup.drive, setup.grid
    first_x, step_x, first_a, step_a = _sensor_and_lens_line(setup, focus, x=rays.x, a=rays.lens.x)
    first_y, step_y, first_b, step_b = _sensor_and_lens_line(setup, focus, x=rays.y, a=rays.lens.y)
    passed, window = rays.lens, []
    if float(drive.shift(focus).min()) != float(drive.shift(float(focus[0] + focus[-1]) / 2)):
        first_lens, step_lens = mi.Point2f(first_a, first_b), mi.Vector2f(step_a, step_b)
        window = through_aperture(first_lens, step_lens, radius=drive.aperture_radius_m, positions=focus.size)
        middle_of_window = mi.Float(window[0] + window[1] - 1) / 2
        passed = mi.Point2f(first_a + step_a * middle_of_window, first_b + step_b * middle_of_window)
    waves = find_waves(drive, grid, wavelength_m=setup.wavelength_m, ends=(float(focus[0]), float(focus[-1])))
    if waves:
        angle = waves.bend(passed, place_bends(rays.pixel, rays.sample, seed=seed))
        first_v, step_v = _image_distance_line(setup, focus)
        first_x, first_y = first_x + first_v * angle.x, first_y + first_v * angle.y
        step_x, step_y = step_x + step_v * angle.x, step_y + step_v * angle.y
    pixels_per_m = _opaque_reciprocal(grid.pitch_m)
    return TracedPaths(
        first_x * pixels_per_m + opaque(grid.columns / 2),
        first_y * pixels_per_m + opaque(grid.rows / 2),
        step_x * pixels_per_m,
        step_y * pixels_per_m,
        None,
        *window,
    )


def pick_rays(ray: Any, chosen: Any) -> Any:
    """Return some of Dr.Jit's rays, by their indices, uint32 (chosen,), of numpy or Dr.Jit."""
    index = mi.UInt32(aligned(chosen)) if isinstance(chosen, np.ndarray) else chosen
    return dr.gather(type(ray), ray, index)


def opaque(value: Any) -> Any:
    """Return a number as an input of the kernel; if it were a constant, each value would need a separate kernel."""
    return dr.opaque(mi.Float, float(value))


def _opaque_reciprocal(value: Any) -> Any:
    """Return 1/value, rounded to float32, as an input of the kernel, which then multiplies instead of dividing."""
    return opaque(np.float32(1) / np.float32(value))


def _sensor_and_lens_line(setup: RenderSetup, focus: np.ndarray, *, x: Any, a: Any) -> tuple[Any, Any, Any, Any]:
    """Return the first position (m) on the sensor and its step per focus position, then the same for the lens.

    Steps come from the difference of the ends in double precision: single precision would keep only three digits for a
    stage that moves by micrometres at distances of millimetres.
    """
    first, last = setup.drive.ray_transfer(focus[[0, -1]], float(focus[0] + focus[-1]) / 2)
    step = (last - first) / (focus.size - 1)
    xx, xa, ax, aa, dxx, dxa, dax, daa = map(opaque, (*first.ravel(), *step.ravel()))
    return x * xx + a * xa, x * dxx + a * dxa, x * ax + a * aa, x * dax + a * daa


def _image_distance_line(setup: RenderSetup, focus: np.ndarray) -> tuple[Any, Any]:
    """Return the image distance v (m) at the first position, and its step; a bend moves a path by v·angle."""
    first, last = setup.drive.image_distance(focus[[0, -1]])
    return opaque(first), opaque((last - first) / (focus.size - 1))


def through_aperture(first: Any, step: Any, *, radius: float, positions: int) -> list[Any]:
    """Return ``begin`` and ``end``, int32: a ray is inside the aperture at positions begin <= k < end.

    The ray passes the lens at first + k·step (m), and |first + k·step|² = R² is a quadratic in k. The root for which
    the textbook formula subtracts nearly equal numbers is computed as q/(...), so that a ray that moves very little
    keeps its digits.
    """
    per_radius = _opaque_reciprocal(radius)
    first, step = first * per_radius, step * per_radius
    q, b, c = 1 - dr.squared_norm(first), dr.dot(first, step), dr.squared_norm(step)
    root = dr.sqrt(dr.maximum(b * b + c * q, 0))  # negative if the ray misses: it then leaves before it enters
    far = root + dr.abs(b)  # 0 if the ray does not move across the lens: it is always inside or always outside
    one = dr.select(far > 0, q / far, dr.copysign(float(NEVER), q))
    other = dr.select(c > 0, far / c, float(NEVER))
    last = opaque(positions - 1)
    # Neither is nan: numerators are finite, and where both parts of a quotient are 0, NEVER is selected.
    leaves = dr.select(b > 0, one, other)
    enters = dr.select(b > 0, -other, -one)
    begin = mi.Int32(dr.ceil(dr.clip(enters, 0, last + 1)))
    end = mi.Int32(dr.floor(dr.clip(leaves, -1, last))) + 1
    return [begin, end]


def aligned(array: np.ndarray) -> np.ndarray:
    """Return a copy at a multiple of 64 bytes, because a kernel's code depends on how its memory is aligned."""
    buffer = np.empty(array.nbytes + 64, dtype=np.uint8)
    begin = -buffer.ctypes.data % 64
    copy = buffer[begin : begin + array.nbytes].view(array.dtype)
    copy[:] = array
    return copy
