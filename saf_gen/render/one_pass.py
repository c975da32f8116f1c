"""A focal stack in one pass: each light path is traced once and counts for every focus position.

A ray that meets sensor and lens at (x, a) at the middle position meets them at M(p)·(x, a) at position p,
with M the drive's transfer, linear in p. Rays are spread evenly over sensor and lens, and over a border round
both that is wide enough that no position lacks rays (:func:`saf_gen.render.ray_sampling.compute_ray_coverage`). M
keeps them evenly spread. Where the lens moves through the rays, a path counts only at the positions that have
it inside the aperture. The paths that fall into a pixel are thus an even sample of pixel and aperture at
every position, and their mean is unbiased. Waves bend a path at the lens, which moves its line across the sensor
(:mod:`saf_gen.render.diffraction`).
"""

import math
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.core import seeds
from saf_gen.render.device_splat import DeviceAccumulator
from saf_gen.render.diffraction import find_aperture_waves, place_bend_samples
from saf_gen.render.host_splat import NEVER, VALUE_BITS, HostAccumulator, TracedPaths
from saf_gen.render.ray_sampling import compute_ray_coverage, place_ray_samples
from saf_gen.render.render_setup import RenderSetup, positions_to_render

PATHS_PER_PASS = 1 << 22


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
    """Render the mean radiance at evenly spaced focus positions in one pass over the scene.

    Needs a JIT backend (llvm or cuda).

    Parameters
    ----------
    setup : the lit scene in front of its lens.
    positions : number of positions over the whole travel, at least 2.
    samples : paths per pixel and position, at least.
    seed : seed of the paths.
    window : first and last index of the positions to render, by default all.
    progress : called with the fraction done, 0...1.
    on_device : accumulate on the device that traces, by default with cuda only. The stack is the same, bit
        for bit. Sums that do not fit there are made in bands of rows, and the paths traced again for each.

    Returns
    -------
    The stack, float32 (focus, row, col), and the number of paths, of all traced, that were clipped as
    fireflies.
    """
    focus = positions_to_render(positions, window)
    traced = trace_paths(setup, focus, samples=samples, seed=seed)
    first = next(traced)
    whole = first[0] >= 1
    if whole:
        most = _brightest([first])
    else:  # brighter paths than 64 times the brightest at one sample per pixel are fireflies
        most = 64 * _brightest(trace_paths(setup, focus, samples=1, seed=seeds.derive_seed(seed, "trial")))
    # A pixel's sum stays below 2**VALUE_BITS for four times the requested samples, or for twice those that
    # come together where a very long travel makes the image smallest.
    # Paths that waves bend are spread as by chance: of 8 or fewer, more than 32 come together once in 10¹⁰ pixels.
    together = max(4.0 * samples, 2 * _densest(setup, focus) * samples, 32.0)
    scale = 2.0**VALUE_BITS / (together * most)
    accumulator = choose_accumulator(on_device)
    shape = (focus.size, setup.grid.rows, setup.grid.columns)
    bands = accumulator.split_into_bands(shape)

    def render_band(n: int) -> tuple[np.ndarray, int]:
        sums, clipped = accumulator(shape, bands[n], scale=scale, most=most), 0
        again = [first] if whole else trace_paths(setup, focus, samples=samples, seed=seed)
        for done, paths in chain([first], traced) if n == 0 else again:
            clipped += sums.add(paths)
            progress((n + done) / len(bands))
        return sums.mean_radiance(), clipped

    stacks, clipped = zip(*map(render_band, range(len(bands))), strict=True)
    # Every band saw the same paths, so each clipped the same number.
    return stacks[0] if len(stacks) == 1 else np.concatenate(stacks, axis=1), clipped[0]


def choose_accumulator(on_device: bool | None) -> type[DeviceAccumulator | HostAccumulator]:
    """Return the accumulator of a choice; None chooses the device with cuda only."""
    if on_device is None:
        on_device = dr.backend_v(mi.Float) == dr.JitBackend.CUDA
    return DeviceAccumulator if on_device else HostAccumulator


def _densest(setup: RenderSetup, focus: np.ndarray) -> float:
    """Return the samples per pixel at the position where they lie densest, over the requested number."""
    transfer = setup.drive.ray_transfer(focus[[0, -1]], float(focus[0] + focus[-1]) / 2)
    return float((np.linalg.det(transfer) ** -2).max())


def _brightest(traced: Iterable[tuple[float, TracedPaths]]) -> float:
    """Return the largest radiance of all paths, or 1.0 where all are dark."""
    return max(float(dr.max(paths.radiance)[0]) for _, paths in traced) or 1.0


def trace_paths(
    setup: RenderSetup, focus: np.ndarray, *, samples: int, seed: int
) -> Iterator[tuple[float, TracedPaths]]:
    """Trace band after band of rows for these positions (at least two, evenly spaced).

    Yields the fraction done, 0...1, and the paths of the band as evaluated arrays of Dr.Jit.
    """
    drive, grid, units = setup.drive, setup.grid, 1 / setup.unit_m
    middle = float(focus[0] + focus[-1]) / 2
    ends = float(focus[0]), float(focus[-1])
    waves = find_aperture_waves(drive, grid, wavelength_m=setup.wavelength_m, ends=ends)
    covered = compute_ray_coverage(drive, grid, ends=ends, bend_reach_m=waves.reach_m if waves else 0.0)
    # Each position still gets the requested samples through the part of the lens disc that is its aperture.
    samples = math.ceil(samples * (covered.radius_m / drive.aperture_radius_m) ** 2 - 1e-9)
    rows, columns = grid.rows + 2 * covered.rows, grid.columns + 2 * covered.columns
    rows_per_pass = max(1, PATHS_PER_PASS // (columns * samples))
    sampler = mi.load_dict({"type": "independent"})
    inverse_v, inverse_u = (
        _opaque(np.float32(1) / np.float32(distance(middle)))
        for distance in (drive.image_distance, drive.object_distance)
    )
    # Rays start where the lens is farthest from the scene; trace_depth_and_target() has made sure that no
    # surface lies between.
    farthest = float(drive.shift(focus).min())
    ahead = farthest - float(drive.shift(middle))
    moves = ahead != 0
    ahead, farthest, radius = _opaque(ahead), _opaque(farthest), _opaque(covered.radius_m)
    half_rows, half_columns = _opaque(rows / 2), _opaque(columns / 2)
    samples_word, row_length = dr.opaque(mi.UInt32, samples), dr.opaque(mi.UInt32, columns)
    transform = mi.Transform4f(setup.to_world)
    for begin in range(0, rows, rows_per_pass):
        count = min(rows_per_pass, rows - begin)
        size = count * columns * samples
        sampler.seed(seeds.derive_seed(seed, begin) & 0xFFFFFFFF, size)
        index = dr.arange(mi.UInt32, size)
        pixel, sample = index // samples_word, index % samples_word
        # The band is traced column by column, so that the pixels that neighbours add to stay in the cache.
        height = dr.opaque(mi.UInt32, count)
        row, column = pixel % height + dr.opaque(mi.UInt32, begin), pixel // height
        pixel = row * row_length + column
        across, down, lens = place_ray_samples(pixel, sample, seed=seed)
        x = (mi.Float(column) + across - half_columns) * grid.pitch_m
        y = (mi.Float(row) + down - half_rows) * grid.pitch_m
        a = mi.warp.square_to_uniform_disk_concentric(lens) * radius
        # Slope in object space. The equal (a - x)/v - a/f would lose digits where u is much larger than f.
        slope_x, slope_y = -(x * inverse_v + a.x * inverse_u), -(y * inverse_v + a.y * inverse_u)
        origin = mi.Point3f(a.x + slope_x * ahead, a.y + slope_y * ahead, farthest) * units
        ray = mi.RayDifferential3f(transform @ origin, transform @ dr.normalize(mi.Vector3f(slope_x, slope_y, 1)))
        radiance, _, _ = setup.integrator.sample(setup.mitsuba_scene, sampler, ray)
        value = radiance.x if dr.size_v(radiance) == 1 else mi.luminance(radiance)
        first_x, step_x, first_a, step_a = _sensor_and_lens_line(setup, focus, x=x, a=a.x)
        first_y, step_y, first_b, step_b = _sensor_and_lens_line(setup, focus, x=y, a=a.y)
        passed, window = a, []
        if moves:
            first_lens, step_lens = mi.Point2f(first_a, first_b), mi.Vector2f(step_a, step_b)
            window = positions_through_aperture(
                first_lens, step_lens, radius=drive.aperture_radius_m, positions=focus.size
            )
            middle_of_window = mi.Float(window[0] + window[1] - 1) / 2
            passed = mi.Point2f(first_a + step_a * middle_of_window, first_b + step_b * middle_of_window)
        if waves:
            angle = waves.bend(passed, place_bend_samples(pixel, sample, seed=seed))
            first_v, step_v = _image_distance_line(setup, focus)
            first_x, first_y = first_x + first_v * angle.x, first_y + first_v * angle.y
            step_x, step_y = step_x + step_v * angle.x, step_y + step_v * angle.y
        pitch = grid.pitch_m
        paths = [
            first_x / pitch + grid.columns / 2,
            first_y / pitch + grid.rows / 2,
            step_x / pitch,
            step_y / pitch,
            value,
            *window,
        ]
        dr.eval(*paths)
        yield (begin + count) / rows, TracedPaths(*paths)


def _opaque(value: Any) -> Any:
    """Return a number that the kernel reads; as a constant, every value would need a kernel of its own."""
    return dr.opaque(mi.Float, float(value))


def _sensor_and_lens_line(setup: RenderSetup, focus: np.ndarray, *, x: Any, a: Any) -> tuple[Any, Any, Any, Any]:
    """Return where rays meet the sensor at the first position, their step per position, and both on the lens.

    All are in metres.

    Steps come from the difference of the ends in double precision: single precision would keep three digits
    for a stage that moves by micrometres at millimetres.
    """
    first, last = setup.drive.ray_transfer(focus[[0, -1]], float(focus[0] + focus[-1]) / 2)
    step = (last - first) / (focus.size - 1)
    xx, xa, ax, aa, dxx, dxa, dax, daa = map(_opaque, (*first.ravel(), *step.ravel()))
    return x * xx + a * xa, x * dxx + a * dxa, x * ax + a * aa, x * dax + a * daa


def _image_distance_line(setup: RenderSetup, focus: np.ndarray) -> tuple[Any, Any]:
    """Return v (m) at the first position and its step per position: by what an angle moves a path on the sensor."""
    first, last = setup.drive.image_distance(focus[[0, -1]])
    return _opaque(first), _opaque((last - first) / (focus.size - 1))


def positions_through_aperture(first: Any, step: Any, *, radius: float, positions: int) -> list[Any]:
    """Return begin and end, int32: first + k·step (m) lies in the aperture for begin <= k < end.

    |first + k·step|² = R² is a quadratic in k. The root for which the textbook formula subtracts nearly equal
    numbers is computed as q/(...), so that a ray that hardly moves keeps its digits.
    """
    first, step = first / radius, step / radius
    q, b, c = 1 - dr.squared_norm(first), dr.dot(first, step), dr.squared_norm(step)
    root = dr.sqrt(dr.maximum(b * b + c * q, 0))  # below 0 the ray misses: it leaves before it enters
    far = root + dr.abs(b)  # 0 for a ray that does not move across the lens: it is always inside, or never
    one = dr.select(far > 0, q / far, dr.copysign(float(NEVER), q))
    other = dr.select(c > 0, far / c, float(NEVER))
    last = _opaque(positions - 1)
    leaves = dr.select(b > 0, one, other)
    enters = dr.select(b > 0, -other, -one)
    begin = mi.Int32(dr.ceil(dr.clip(enters, 0, last + 1)))
    end = mi.Int32(dr.floor(dr.clip(leaves, -1, last))) + 1
    return [begin, end]
