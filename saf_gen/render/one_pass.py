"""A focal stack in one pass: each light path is traced once and counts at every focus position.

This is the plain estimator, whose mean is unbiased: each pixel is the mean of the light paths that fall into it.
:mod:`saf_gen.render.filtered_pass` needs fewer paths for the same grain. :mod:`saf_gen.render.camera_rays` explains why
one path serves all positions.
"""

from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.core import seeds
from saf_gen.render.camera_rays import cast_rays, land_on_sensor
from saf_gen.render.device_splat import DeviceAccumulator, DeviceBands
from saf_gen.render.host_splat import VALUE_BITS, HostAccumulator, TracedPaths
from saf_gen.render.render_setup import RenderSetup, positions_to_render

Accumulator = DeviceBands | HostAccumulator
FIREFLY_FACTOR = 64  # paths are clipped above this many times the brightest path at one sample per pixel


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
    setup : RenderSetup
        Lit scene in front of its lens.
    positions : int
        Number of positions over the full travel, at least 2.
    samples : int
        Smallest number of paths per pixel and position.
    seed : int
        Seed of the paths.
    window : tuple of int, optional
        First and last index of the positions to render; by default all.
    progress : callable, optional
        Called with the completed fraction, 0 to 1.
    on_device : bool, optional
        Whether to accumulate on the device that traces; by default only with cuda. The stack is the same, bit for bit.
        Sums that do not fit there are made in bands of rows, and the paths are traced again for each band.

    Returns
    -------
    stack : ndarray of float32, shape (focus, row, col)
        Mean radiance.
    clipped : int
        Number of traced paths that were clipped as fireflies.
    """
    focus = positions_to_render(positions, window)
    traced = trace_paths(setup, focus, samples=samples, seed=seed)
    first = next(traced)
    is_complete = first[0] >= 1
    if is_complete:
        max_radiance = _brightest([first])
    else:
        coarse = trace_paths(setup, focus, samples=1, seed=seeds.derive_seed(seed, "trial"))
        max_radiance = FIREFLY_FACTOR * _brightest(coarse)
    scale = fixed_point_scale(setup, focus, samples=samples, max_radiance=max_radiance)
    accumulator = choose_accumulator(on_device)
    shape = (focus.size, setup.grid.rows, setup.grid.columns)
    bands = accumulator.split_into_bands(shape)

    def render_band(n: int) -> tuple[np.ndarray, int]:
        sums: Any = accumulator(shape, bands[n], scale=scale, max_radiance=max_radiance)
        clipped: Any = 0
        again = [first] if is_complete else trace_paths(setup, focus, samples=samples, seed=seed)
        for done, paths in chain([first], traced) if n == 0 else again:
            clipped += sums.add(paths)
            progress((n + done) / len(bands))
        return sums.mean_radiance(), int(clipped if isinstance(clipped, int) else clipped[0])

    stacks, clipped = zip(*map(render_band, range(len(bands))), strict=True)
    # Every band saw the same paths, so each clipped the same number.
    return stacks[0] if len(stacks) == 1 else np.concatenate(stacks, axis=1), clipped[0]


def sums_on_device(on_device: bool | None) -> bool:
    """Return ``on_device``, or if it is None, whether the backend is cuda."""
    return dr.backend_v(mi.Float) == dr.JitBackend.CUDA if on_device is None else on_device


def choose_accumulator(on_device: bool | None) -> type[DeviceAccumulator | HostAccumulator]:
    """Return the class of accumulator; if ``on_device`` is None, sums are on the device only with cuda."""
    return DeviceAccumulator if sums_on_device(on_device) else HostAccumulator


def start_sums(
    setup: RenderSetup, focus: np.ndarray, *, samples: int, max_radiance: float, stacks: int, on_device: bool | None
) -> Accumulator:
    """Return empty sums of one of ``stacks`` stacks, on the tracing device if it is chosen."""
    shape = (focus.size, setup.grid.rows, setup.grid.columns)
    scale = fixed_point_scale(setup, focus, samples=samples, max_radiance=max_radiance)
    if sums_on_device(on_device):
        return DeviceBands(shape, scale=scale, max_radiance=max_radiance)
    return HostAccumulator(shape, (0, shape[1]), scale=scale, max_radiance=max_radiance, stacks=stacks)


def fixed_point_scale(setup: RenderSetup, focus: np.ndarray, *, samples: int, max_radiance: float) -> float:
    """Return the fixed-point units per unit of radiance.

    A pixel's sum stays below 2**VALUE_BITS for four times the requested samples, or for twice the samples that meet in
    a pixel at the position at which a very long travel makes the image smallest. Waves spread paths as if at random:
    with 8 or fewer samples per pixel, more than 32 meet in one of 10¹⁰ pixels.
    """
    together = max(4.0 * samples, 2 * _densest(setup, focus) * samples, 32.0)
    return float(2.0**VALUE_BITS / (together * max_radiance))


def _densest(setup: RenderSetup, focus: np.ndarray) -> float:
    """Return the largest number of samples per pixel at any position, divided by the requested number."""
    transfer = setup.drive.ray_transfer(focus[[0, -1]], float(focus[0] + focus[-1]) / 2)
    return float((np.linalg.det(transfer) ** -2).max())


def _brightest(traced: Iterable[tuple[float, TracedPaths]]) -> float:
    """Return the largest radiance of all paths, or 1.0 if all are dark."""
    return max(float(dr.max(paths.radiance)[0]) for _, paths in traced) or 1.0


def trace_paths(
    setup: RenderSetup, focus: np.ndarray, *, samples: int, seed: int
) -> Iterator[tuple[float, TracedPaths]]:
    """Trace one band of rows after another for these positions (at least two, evenly spaced).

    Yields the completed fraction, 0 to 1, and the paths of the band as evaluated Dr.Jit arrays.
    """
    sampler = mi.load_dict({"type": "independent"})
    for rays in cast_rays(setup, focus, samples=samples, seed=seed):
        ((begin, _, _),) = rays.bands
        sampler.seed(seeds.derive_seed(seed, begin) & 0xFFFFFFFF, dr.width(rays.x))
        radiance, _, _ = setup.integrator.sample(setup.mitsuba_scene, sampler, rays.ray)
        value = radiance.x if dr.size_v(radiance) == 1 else mi.luminance(radiance)
        if rays.passes is not None:
            value = dr.select(rays.passes, value, 0)
        paths = land_on_sensor(rays, setup, focus=focus, seed=seed)._replace(radiance=value)
        dr.eval(*(array for array in paths if array is not None))
        yield rays.done, paths
