"""A focal stack in one pass: each light path is traced once and counts for every focus position.

For a lens that moves against the sensor, a ray through lens point a that meets the reference plane v_0 at
x_0 meets the plane v_k at x_k = r·x_0 + (1 - r)·a with r = v_k/v_0: linear in v_k, so linear in the
position. Reference points are spread evenly over the sensor and a guard band round it, wide enough that no
position misses a ray at its border; the estimate at every position is then unbiased.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any

import drjit as dr
import mitsuba as mi
import numba as nb
import numpy as np

from saf_gen import seeds
from saf_gen.optics import ImageDistance
from saf_gen.render import splat
from saf_gen.render.film import Film

__all__ = ["guard", "render_stack"]

PATHS_A_PASS = 1 << 22
# Kronecker sequence over pixel and lens (4 dimensions): powers of the root of x^5 = x + 1, in 0.32 fixed
# point. Any number of samples is spread well, where orthogonal arrays need the square of a prime.
# M. Roberts, "The unreasonable effectiveness of quasirandom sequences" (2018).
GOLDEN = 1.1673039782614187
STEPS = tuple(round(GOLDEN ** -(j + 1) * 2**32) & 0xFFFFFFFF for j in range(4))


def render_stack(
    world: Any,
    integrator: Any,
    to_world: Any,
    drive: ImageDistance,
    film: Film,
    *,
    positions: int,
    samples: int,
    seed: int,
    progress: Callable[[float], None] = lambda done: None,
) -> np.ndarray:
    """Mean radiance at evenly spaced positions, float32 (focus, row, col), in one pass over the scene.

    ``progress`` is told the share done, 0...1. Needs a JIT variant (llvm or cuda).
    """
    scale, most = _fixed_point(world, integrator, to_world, drive, film, samples, seed)
    sums = splat.accumulators(nb.get_num_threads(), (positions, film.rows, film.columns))
    lines = _Lines(drive, film, positions)
    for done, paths in _trace(world, integrator, to_world, drive, film, samples, seed):
        origin_x, origin_y, lens_x, lens_y, radiance = paths
        first_x, step_x = lines.along(origin_x, lens_x, film.columns)
        first_y, step_y = lines.along(origin_y, lens_y, film.rows)
        splat.splat(sums, first_x, first_y, step_x, step_y, radiance, scale, most)
        progress(done)
    return splat.resolve(sums, scale)


class _Lines:
    """Where paths run through the stack, in pixels against the position's index."""

    def __init__(self, drive: ImageDistance, film: Film, positions: int) -> None:
        v = drive.image_distance(np.array([0.0, 0.5, 1.0]))
        self._first, self._last = v[0] / v[1], v[2] / v[1]
        self._steps, self._pitch = positions - 1, film.pitch_m

    def along(self, x: np.ndarray, lens: np.ndarray, pixels: int) -> tuple[np.ndarray, np.ndarray]:
        """Place at position 0 and step from one position to the next, float32, in pixels from the edge."""
        first = (self._first * x + (1 - self._first) * lens) / self._pitch + pixels / 2
        last = (self._last * x + (1 - self._last) * lens) / self._pitch + pixels / 2
        return first.astype(np.float32), ((last - first) / self._steps).astype(np.float32)


def guard(drive: ImageDistance, film: Film) -> tuple[int, int]:
    """Pixels (rows, columns) to add on each side so that every position's border sees all its rays."""
    v = drive.image_distance(np.array([0.0, 0.5, 1.0]))
    ratio = v / v[1]
    widest = []
    for pixels in (film.rows, film.columns):
        half = pixels / 2
        reach = (half + np.abs(1 - ratio) * drive.aperture_radius_m / film.pitch_m) / ratio
        widest.append(math.ceil(reach.max() - half) + 1)
    return widest[0], widest[1]


def _fixed_point(world, integrator, to_world, drive, film, samples, seed) -> tuple[float, float]:
    """Fixed-point scale and clipping radiance, from one sample a pixel.

    A pixel's sum must stay below 2**VALUE_BITS. Four times the samples asked for may fall in a pixel, and a
    path may carry 64 times the brightest of the trial: what is brighter still is clipped, a firefly.
    """
    brightest = 0.0
    for _, paths in _trace(world, integrator, to_world, drive, film, 1, seeds.integer(seed, "trial")):
        brightest = max(brightest, float(paths[-1].max()))
    most = 64 * brightest if brightest > 0 else 1.0
    return 2.0**splat.VALUE_BITS / (4 * samples * most), most


Paths = tuple[np.ndarray, ...]


def _trace(
    world: Any, integrator: Any, to_world: Any, drive: ImageDistance, film: Film, samples: int, seed: int
) -> Iterator[tuple[float, Paths]]:
    """Trace band after band of rows; yields the share done and (x, y, lens x, lens y, radiance), float32.

    x, y : sensor coordinates at the reference plane (m, from the axis); lens x, y on the lens (m).
    """
    guard_rows, guard_columns = guard(drive, film)
    rows, columns = film.rows + 2 * guard_rows, film.columns + 2 * guard_columns
    rows_a_pass = max(1, PATHS_A_PASS // (columns * samples))
    sampler = mi.load_dict({"type": "independent"})
    v = float(drive.image_distance(0.5))
    for begin in range(0, rows, rows_a_pass):
        count = min(rows_a_pass, rows - begin)
        size = count * columns * samples
        sampler.seed(seeds.integer(seed, begin) & 0xFFFFFFFF, size)
        index = dr.arange(mi.UInt32, size)
        pixel, sample = index // samples, index % samples
        row, column = pixel // columns + dr.opaque(mi.UInt32, begin), pixel % columns
        across, down, lens = _spread(row * columns + column, sample, seed)
        x = (mi.Float(column) + across - columns / 2) * film.pitch_m
        y = (mi.Float(row) + down - rows / 2) * film.pitch_m
        lens_point = mi.warp.square_to_uniform_disk_concentric(lens) * drive.aperture_radius_m
        # Slope of the ray in object space: x = -v (s + a/u) with 1/u = 1/f - 1/v, solved for s.
        slope_x = (lens_point.x - x) / v - lens_point.x / drive.focal_length_m
        slope_y = (lens_point.y - y) / v - lens_point.y / drive.focal_length_m
        transform = mi.Transform4f(to_world)
        ray = mi.RayDifferential3f(
            transform @ mi.Point3f(lens_point.x, lens_point.y, 0),
            transform @ dr.normalize(mi.Vector3f(slope_x, slope_y, 1)),
        )
        radiance, _, _ = integrator.sample(world, sampler, ray)
        value = radiance.x if dr.size_v(radiance) == 1 else mi.luminance(radiance)
        paths = (x, y, lens_point.x, lens_point.y, value)
        dr.eval(*paths)
        yield (begin + count) / rows, tuple(np.array(p, dtype=np.float32).ravel() for p in paths)


def _spread(pixel: Any, sample: Any, seed: int) -> tuple[Any, Any, Any]:
    """Where each sample falls in its pixel (two numbers) and on the unit square of the lens.

    Every pixel turns the same sequence by offsets of its own (Cranley and Patterson 1976).
    """
    turns = []
    for j, step in enumerate(STEPS):
        word: Any = dr.opaque(mi.UInt32, (seed + j) & 0xFFFFFFFF)
        turn, _ = mi.sample_tea_32(pixel, word, 6)
        fixed = turn + sample * mi.UInt32(step)
        turns.append(mi.Float(fixed >> 8) * 2.0**-24)  # 24 bits: what a float32 holds below 1
    return turns[0], turns[1], mi.Point2f(turns[2], turns[3])
