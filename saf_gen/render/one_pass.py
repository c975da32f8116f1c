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
from saf_gen.render.film import Film, Setup

__all__ = ["guard", "render_stack"]

PATHS_A_PASS = 1 << 22
# Kronecker sequence over pixel and lens (4 dimensions): powers of the root of x^5 = x + 1, in 0.32 fixed
# point. Any number of samples is spread well, where orthogonal arrays need the square of a prime.
# M. Roberts, "The unreasonable effectiveness of quasirandom sequences" (2018).
GOLDEN = 1.1673039782614187
STEPS = tuple(round(GOLDEN ** -(j + 1) * 2**32) & 0xFFFFFFFF for j in range(4))


def render_stack(
    setup: Setup,
    *,
    positions: int,
    samples: int,
    seed: int,
    progress: Callable[[float], None] = lambda done: None,
) -> tuple[np.ndarray, int]:
    """Mean radiance at evenly spaced positions, float32 (focus, row, col), in one pass over the scene.

    Returns it with the number of paths that were clipped as fireflies, of all that were traced.
    ``progress`` is told the share done, 0...1. Needs a JIT variant (llvm or cuda).
    """
    film = setup.film
    scale, most = _fixed_point(setup, positions, samples, seed)
    sums = splat.accumulators(nb.get_num_threads(), (positions, film.rows, film.columns))
    clipped = 0
    for done, paths in _trace(setup, positions, samples, seed):
        first_x, first_y, step_x, step_y, radiance = paths
        clipped += int(splat.splat(sums, first_x, first_y, step_x, step_y, radiance, scale, most))
        progress(done)
    return splat.resolve(sums, scale), clipped


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


def _fixed_point(setup: Setup, positions: int, samples: int, seed: int) -> tuple[float, float]:
    """Fixed-point scale and clipping radiance, from one sample a pixel.

    A pixel's sum must stay below 2**VALUE_BITS. Four times the samples asked for may fall in a pixel, and a
    path may carry 64 times the brightest of the trial: what is brighter still is clipped, a firefly.
    """
    brightest = 0.0
    for _, paths in _trace(setup, positions, 1, seeds.integer(seed, "trial")):
        brightest = max(brightest, float(paths[-1].max()))
    most = 64 * brightest if brightest > 0 else 1.0
    return 2.0**splat.VALUE_BITS / (4 * samples * most), most


Paths = tuple[np.ndarray, ...]


def _trace(setup: Setup, positions: int, samples: int, seed: int) -> Iterator[tuple[float, Paths]]:
    """Trace band after band of rows.

    Yields the share done and what :func:`splat.splat` takes: place at position 0 (x, y) and step from one
    position to the next (x, y), in pixels, and radiance, each float32 (path,).
    """
    drive, film = setup.drive, setup.film
    guard_rows, guard_columns = guard(drive, film)
    rows, columns = film.rows + 2 * guard_rows, film.columns + 2 * guard_columns
    rows_a_pass = max(1, PATHS_A_PASS // (columns * samples))
    sampler = mi.load_dict({"type": "independent"})
    v = float(drive.image_distance(0.5))
    transform = mi.Transform4f(setup.to_world)
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
        a = mi.warp.square_to_uniform_disk_concentric(lens) * drive.aperture_radius_m
        # Slope of the ray in object space: x = -v (s + a/u) with 1/u = 1/f - 1/v, solved for s.
        slope = mi.Vector3f(
            (a.x - x) / v - a.x / drive.focal_length_m, (a.y - y) / v - a.y / drive.focal_length_m, 1
        )
        ray = mi.RayDifferential3f(transform @ mi.Point3f(a.x, a.y, 0), transform @ dr.normalize(slope))
        radiance, _, _ = setup.integrator.sample(setup.world, sampler, ray)
        value = radiance.x if dr.size_v(radiance) == 1 else mi.luminance(radiance)
        first_x, step_x = _line(setup, positions, x, a.x, film.columns)
        first_y, step_y = _line(setup, positions, y, a.y, film.rows)
        paths = (first_x, first_y, step_x, step_y, value)
        dr.eval(*paths)
        yield (begin + count) / rows, tuple(np.array(p, dtype=np.float32).ravel() for p in paths)


def _line(setup: Setup, positions: int, x: Any, a: Any, pixels: int) -> tuple[Any, Any]:
    """Place at position 0 and step between positions, in pixels from the edge, of what lies at x at p = ½."""
    v = setup.drive.image_distance(np.array([0.0, 0.5, 1.0]))
    first, last = (float(ratio) for ratio in (v[0] / v[1], v[2] / v[1]))
    pitch, steps = setup.film.pitch_m, positions - 1
    place = (x * first + a * (1 - first)) / pitch + pixels / 2
    return place, (x - a) * ((last - first) / (pitch * steps))


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
