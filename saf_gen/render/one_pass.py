"""A focal stack in one pass: each light path is traced once and counts for every focus position.

A ray that meets sensor and lens at (x, a) half way meets them at M(p)·(x, a) at position p, M the drive's
transfer, linear in p. Rays are spread evenly over film and lens, and over a border round both that is
wide enough that no position misses one (:func:`saf_gen.render.ray_sampling.compute_coverage`). M keeps them
evenly spread;
where the lens moves through the rays a path counts only at positions that have it inside the aperture. So
the paths that fall into a pixel are an even sample of pixel and aperture at every position, and their mean is
unbiased.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.core import seeds
from saf_gen.optics import Drive
from saf_gen.render.device_splat import DeviceAccumulator
from saf_gen.render.host_splat import VALUE_BITS, HostAccumulator, TracedPaths
from saf_gen.render.ray_sampling import compute_coverage, place_samples
from saf_gen.render.render_setup import RenderSetup, rendered_positions

__all__ = ["render_stack"]

PATHS_A_PASS = 1 << 22
NEVER = 1e9  # positions


def render_stack(
    setup: RenderSetup,
    *,
    positions: int,
    samples: int,
    seed: int,
    window: tuple[int, int] | None = None,
    progress: Callable[[float], None] = lambda done: None,
    on_device: bool | None = None,
) -> tuple[np.ndarray, int]:
    """Mean radiance at evenly spaced positions, float32 (focus, row, col), in one pass over the scene.

    ``positions`` lie over the whole travel; ``window``, where given, is the first and the last of them to
    render. Returns the stack with the number of paths that were clipped as fireflies, of all that were
    traced. ``progress`` is told the share done, 0...1. ``on_device`` splats on the device that traces, by
    default under cuda only; the stack is the same bit for bit. Sums that do not fit there are made in bands
    of rows, and the paths traced again for each. Needs a JIT variant (llvm or cuda).
    """
    focus = rendered_positions(positions, window)
    traced = _trace(setup, focus, samples, seed)
    first = next(traced)
    whole = first[0] >= 1
    most = _brightest([first]) if whole else _most_by_trial(setup, focus, seed)
    # A pixel's sum stays below 2**VALUE_BITS with four times the samples asked for in it, or twice those that
    # come together where a very long travel makes the picture smallest.
    scale = 2.0**VALUE_BITS / (max(4.0, 2 * _densest(setup, focus)) * samples * most)
    kind = _kind(on_device)
    shape = (focus.size, setup.film.rows, setup.film.columns)
    bands = kind.split_into_bands(shape)

    def part(n: int) -> tuple[np.ndarray, int]:
        sums, clipped = kind(shape, bands[n], scale, most), 0
        again = [first] if whole else _trace(setup, focus, samples, seed)
        for done, paths in chain([first], traced) if n == 0 else again:
            clipped += sums.add(paths)
            progress((n + done) / len(bands))
        return sums.mean_radiance(), clipped

    stacks, clipped = zip(*map(part, range(len(bands))), strict=True)
    # Every band saw the same paths, so the same were clipped.
    return stacks[0] if len(stacks) == 1 else np.concatenate(stacks, axis=1), clipped[0]


def _densest(setup: RenderSetup, focus: np.ndarray) -> float:
    """Samples a pixel where they lie densest among these positions, over those asked for."""
    transfer = setup.drive.ray_transfer(focus[[0, -1]], float(focus[0] + focus[-1]) / 2)
    return float((np.linalg.det(transfer) ** -2).max())


def _kind(on_device: bool | None) -> type[DeviceAccumulator | HostAccumulator]:
    if on_device is None:
        on_device = dr.backend_v(mi.Float) == dr.JitBackend.CUDA
    return DeviceAccumulator if on_device else HostAccumulator


def _most_by_trial(setup: RenderSetup, focus: np.ndarray, seed: int) -> float:
    """64 times the brightest path of one sample a pixel: what is brighter still is clipped, a firefly.

    For stacks of more than one pass; where one pass has all paths, the brightest of them is known.
    """
    return 64 * _brightest(_trace(setup, focus, 1, seeds.derive_seed(seed, "trial")))


def _brightest(traced: Iterable[tuple[float, TracedPaths]]) -> float:
    """The largest radiance of all paths; 1.0 where all are dark."""
    return max(float(dr.max(paths.radiance)[0]) for _, paths in traced) or 1.0


def _trace(
    setup: RenderSetup, focus: np.ndarray, samples: int, seed: int
) -> Iterator[tuple[float, TracedPaths]]:
    """Trace band after band of rows, for these positions (at least two, evenly spaced).

    Yields the share done, 0...1, and the paths of the band, evaluated arrays of Dr.Jit.
    """
    drive, film, units = setup.drive, setup.film, 1 / setup.unit_m
    middle = float(focus[0] + focus[-1]) / 2
    covered = compute_coverage(drive, film, (float(focus[0]), float(focus[-1])))
    # Each position still gets as many samples as asked for, of the aperture it sees of the lens disc.
    samples = math.ceil(samples * (covered.radius_m / drive.aperture_radius_m) ** 2 - 1e-9)
    rows, columns = film.rows + 2 * covered.rows, film.columns + 2 * covered.columns
    rows_a_pass = max(1, PATHS_A_PASS // (columns * samples))
    sampler = mi.load_dict({"type": "independent"})
    by_v, by_u = (
        _given(np.float32(1) / np.float32(distance(middle)))
        for distance in (drive.image_distance, drive.object_distance)
    )
    # Rays start where the lens stands farthest from the scene; trace_depth_and_target() has found nothing
    # between.
    farthest = float(drive.shift(focus).min())
    ahead = farthest - float(drive.shift(middle))
    moves = ahead != 0
    ahead, farthest, radius = _given(ahead), _given(farthest), _given(covered.radius_m)
    half_rows, half_columns = _given(rows / 2), _given(columns / 2)
    each, across_all = dr.opaque(mi.UInt32, samples), dr.opaque(mi.UInt32, columns)
    transform = mi.Transform4f(setup.to_world)
    for begin in range(0, rows, rows_a_pass):
        count = min(rows_a_pass, rows - begin)
        size = count * columns * samples
        sampler.seed(seeds.derive_seed(seed, begin) & 0xFFFFFFFF, size)
        index = dr.arange(mi.UInt32, size)
        pixel, sample = index // each, index % each
        # Column by column of the band: what neighbours splat into then stays in the cache.
        height = dr.opaque(mi.UInt32, count)
        row, column = pixel % height + dr.opaque(mi.UInt32, begin), pixel // height
        across, down, lens = place_samples(row * across_all + column, sample, seed)
        x = (mi.Float(column) + across - half_columns) * film.pitch_m
        y = (mi.Float(row) + down - half_rows) * film.pitch_m
        a = mi.warp.square_to_uniform_disk_concentric(lens) * radius
        # Slope in object space. Not (a - x)/v - a/f, its equal: that loses digits where u is much above f.
        slope_x, slope_y = -(x * by_v + a.x * by_u), -(y * by_v + a.y * by_u)
        origin = mi.Point3f(a.x + slope_x * ahead, a.y + slope_y * ahead, farthest) * units
        ray = mi.RayDifferential3f(
            transform @ origin, transform @ dr.normalize(mi.Vector3f(slope_x, slope_y, 1))
        )
        radiance, _, _ = setup.integrator.sample(setup.mitsuba_scene, sampler, ray)
        value = radiance.x if dr.size_v(radiance) == 1 else mi.luminance(radiance)
        first_x, step_x, first_a, step_a = _line(setup, focus, x, a.x)
        first_y, step_y, first_b, step_b = _line(setup, focus, y, a.y)
        pitch = film.pitch_m
        paths = [
            first_x / pitch + film.columns / 2,
            first_y / pitch + film.rows / 2,
            step_x / pitch,
            step_y / pitch,
            value,
        ]
        if moves:
            paths += _window(mi.Point2f(first_a, first_b), mi.Vector2f(step_a, step_b), drive, focus.size)
        dr.eval(*paths)
        yield (begin + count) / rows, TracedPaths(*paths)


def _given(value: Any) -> Any:
    """A number that the kernel reads, where one written into it would have it compiled for each window."""
    return dr.opaque(mi.Float, float(value))


def _line(setup: RenderSetup, focus: np.ndarray, x: Any, a: Any) -> tuple[Any, Any, Any, Any]:
    """Place on the sensor at the first position and step between positions, and the same on the lens (m).

    Steps come from the difference of the ends, taken in double precision: in single it would keep three
    digits of a stage that moves by micrometres at millimetres.
    """
    first, last = setup.drive.ray_transfer(focus[[0, -1]], float(focus[0] + focus[-1]) / 2)
    step = (last - first) / (focus.size - 1)
    xx, xa, ax, aa, dxx, dxa, dax, daa = map(_given, (*first.ravel(), *step.ravel()))
    return x * xx + a * xa, x * dxx + a * dxa, x * ax + a * aa, x * dax + a * daa


def _window(first: Any, step: Any, drive: Drive, positions: int) -> list[Any]:
    """The positions begin <= k < end at which first + k·step (m) lies in the aperture, int32.

    |first + k·step|² = R² is a quadratic in k. One of its roots is taken as q/(...), on the side where the
    textbook's formula subtracts like numbers: a ray that hardly moves then keeps its digits.
    """
    radius = drive.aperture_radius_m
    first, step = first / radius, step / radius
    q, b, c = 1 - dr.squared_norm(first), dr.dot(first, step), dr.squared_norm(step)
    root = dr.sqrt(dr.maximum(b * b + c * q, 0))  # below 0: it misses, and leaves before it enters
    far = root + dr.abs(b)  # 0 for a ray that does not move across the lens: always in, or never
    one = dr.select(far > 0, q / far, dr.copysign(NEVER, q))
    other = dr.select(c > 0, far / c, NEVER)
    last = _given(positions - 1)
    leaves = dr.select(b > 0, one, other)
    enters = dr.select(b > 0, -other, -one)
    begin = mi.Int32(dr.ceil(dr.clip(enters, 0, last + 1)))
    end = mi.Int32(dr.floor(dr.clip(leaves, -1, last))) + 1
    return [begin, end]
