"""A focal stack with less grain than its light paths have: they share shading, but not visibility or texture.

Most of the noise of a traced picture comes from the light that a path finds, by chance, where it meets a surface. The
rest comes from the detail of the texture that happens to be seen through each part of the lens. The two are therefore
sampled separately:

1. Complete light paths, under each light group, sample the shading of the surfaces that camera rays meet first
   (:mod:`saf_gen.render.shading_cells`). They start evenly over the full travel, so that the shading does not depend on
   where the lens is.
2. PRIMARY_RAYS times as many camera rays, the same for all groups, are traced to their first surface only. Each brings
   the reflectance there times the shading of its cell.

Rays look through clear surfaces (:mod:`saf_gen.render.line_of_sight`). Rays that end at a surface that cannot share
shading (:mod:`saf_gen.render.surface_hits`) must be traced on: one in PRIMARY_RAYS is, and counts for the others too.

A moving scene is rendered at many moments. Shading that stays in place from one moment to the next is estimated from
the paths of several moments, each with a quarter as many paths. Shading that has changed by more than the noise is
found from the paths of the latest moment alone.

The result is biased where shading changes within a cell; the bias falls as the number of samples grows
(docs/renderer.md#shared-shading).
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple, cast

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.core import seeds
from saf_gen.render import backend, one_pass
from saf_gen.render.camera_rays import CameraRays, cast_rays, land_on_sensor, pick_rays
from saf_gen.render.device_layers import DeviceLayeredSums
from saf_gen.render.device_shading import DeviceField
from saf_gen.render.device_splat import product
from saf_gen.render.layered_splat import BlurScale, LayeredSums
from saf_gen.render.render_setup import RenderSetup, positions_to_render
from saf_gen.render.shading_cells import CellTable, ShadingCells, ShadingField, SurfaceHits
from saf_gen.render.surface_hits import Distances, Sight, SurfaceFinder
from saf_gen.render.traced_light import finite, lamp_radiance, reflected_radiance, to_host, trace_radiance
from saf_gen.stack.focal_stack import LAYERED_POSITIONS

PRIMARY_RAYS = 6  # camera rays per light path
RAYS_INTO_LIGHT = 3  # the number in layers, if most rays end straight in light: only texture is left to chance
UNSHARED_PATHS = 2  # light paths per requested sample, if most rays must be traced on


def gather_shading(
    setups: Mapping[str, RenderSetup],
    *,
    samples: int,
    seed: int,
    emitting: Collection[str] = (),
    progress: Callable[[float], None] = lambda done: None,
    on_device: bool | None = None,
) -> ShadingCells:
    """Trace complete light paths under a scene's light groups, and collect their light in cells of the surfaces.

    Needs a JIT backend (llvm or cuda). The result for a group does not depend on which other groups are traced.

    Parameters
    ----------
    setups : mapping of str to RenderSetup
        The same scene under each light group, by name.
    samples : int
        Smallest number of light paths per pixel and light group.
    seed : int
        Seed of the paths.
    emitting : collection of str
        Ids of the shapes that are lamps under any group of the scene.
    progress : callable, optional
        Called with the completed fraction, 0 to 1.
    on_device : bool, optional
        Whether only what is added to cells comes down from the device that traces; by default only with cuda. The cells
        are the same, bit for bit.

    Returns
    -------
    ShadingCells
        Sums of the paths in each cell.
    """
    finder = SurfaceFinder(next(iter(setups.values())), emitting=emitting)
    on_device = one_pass.sums_on_device(on_device)
    bands = _trace_complete_paths(setups, finder, samples=samples, seed=seed, on_device=on_device)
    opening = next(bands)
    max_radiance = _brightest([opening])
    if not opening.is_all:
        trial = seeds.derive_seed(seed, "trial")
        coarse = _trace_complete_paths(setups, finder, samples=1, seed=trial, on_device=on_device)
        max_radiance = one_pass.FIREFLY_FACTOR * _brightest(coarse)
    cells = CellTable(len(setups))
    for band in chain([opening], bands):
        cells.add(band.hits, np.minimum(band.radiance, max_radiance.astype(np.float32)[:, None]))
        cells.count_rays(band.ray_count, unshared=band.unshared, in_light=band.in_light)
        progress(band.done)
    return cells.by_tile()


def estimate_shading(moments: Sequence[ShadingCells]) -> ShadingField:
    """Return the shading at the last of several moments, estimated from the paths of all of them."""
    together = ShadingCells.merged(moments).estimate()
    return together if len(moments) == 1 else moments[-1].estimate(together)


def render_with_shading(
    setups: Mapping[str, RenderSetup],
    shading: ShadingField,
    *,
    positions: int,
    samples: int,
    seed: int,
    emitting: Collection[str] = (),
    window: tuple[int, int] | None = None,
    progress: Callable[[float], None] = lambda done: None,
    on_device: bool | None = None,
) -> dict[str, tuple[np.ndarray, int]]:
    """Render a scene's light groups together, at evenly spaced focus positions.

    Needs a JIT backend (llvm or cuda).

    Parameters
    ----------
    setups : mapping of str to RenderSetup
        The same scene under each light group, by name.
    shading : ShadingField
        Shading of the scene's surfaces, with the light groups in the order of ``setups``.
    samples : int
        Requested samples. At least PRIMARY_RAYS (or RAYS_INTO_LIGHT) times as many camera rays per pixel and position
        are cast, of which ``samples`` are traced on if they meet a surface that shares no shading. If most rays meet
        such surfaces, UNSHARED_PATHS times as many are cast, and all rays that meet them are traced on.
    emitting : collection of str
        Ids of the shapes that are lamps under any group of the scene.
    positions, seed, window, progress, on_device
        See :func:`saf_gen.render.one_pass.render_stack`.

    Returns
    -------
    dict of str to tuple of (ndarray, int)
        For each group the stack, float32 (focus, row, col), and the number of light paths that were clipped as
        fireflies.
    """
    focus = positions_to_render(positions, window)
    first = next(iter(setups.values()))
    finder = SurfaceFinder(first, emitting=emitting)
    rays_per_path = 1  # if little is shared, rays that are not traced on would contribute little
    if shading.unshared < 0.5:
        layered = focus.size <= LAYERED_POSITIONS and first.drive.fills_its_aperture_perfectly
        rays_per_path = RAYS_INTO_LIGHT if layered and shading.in_light > 0.5 else PRIMARY_RAYS
    samples *= rays_per_path if rays_per_path > 1 else UNSHARED_PATHS
    on_device = one_pass.sums_on_device(on_device)
    in_memory = DeviceField(shading) if on_device else None

    at_once = backend.bands_at_once() if on_device else 1

    def bring_light(samples: int, seed: int) -> Iterator[LitRays]:
        for rays in cast_rays(first, focus, samples=samples, seed=seed, at_once=at_once):
            sight = finder.find(
                rays, focus, seed=seeds.derive_seed(seed, "lines of sight"), on_device=in_memory is not None
            )
            if in_memory is not None:
                yield _light_on_device(
                    setups, in_memory, rays=rays, sight=sight, rays_per_path=rays_per_path, seed=seed
                )
                continue
            values = shading.reflect(sight.hits, first=rays.first, seed=seed)
            weight, chosen = _choose_rays_to_trace_on(rays, sight.unshared, rays_per_path=rays_per_path)
            ((begin, _, _),) = rays.bands
            for n, (name, setup) in enumerate(setups.items()):
                if chosen.size:
                    values[n, chosen] = _trace_on(
                        setup, sight, chosen=chosen, seed=seeds.derive_seed(seed, name, begin)
                    )
                if sight.factor is not None:
                    values[n] *= sight.factor
                for end in sight.lights:
                    light = to_host(lamp_radiance(setup, pick_rays(end.ray, end.rays)))
                    values[n, end.rays] += light * end.clearness
            if rays.passes is not None:
                values *= rays.passes.numpy()
            yield LitRays(rays, sight.distances, values, weight)

    bands = bring_light(samples, seed)
    opening = next(bands)
    max_radiance = _brightest([opening])
    if (
        not opening.rays.is_only_band
    ):  # as in a plain stack, the limit comes from the full picture, not from its first rows
        max_radiance = one_pass.FIREFLY_FACTOR * _brightest(bring_light(1, seeds.derive_seed(seed, "trial")))
    sums = _Sums(setups, focus, samples=samples, max_radiance=max_radiance, on_device=on_device)
    clipped: Any = [0] * len(setups)
    for band in chain([opening], bands):
        clipped = [n + more for n, more in zip(clipped, band.count_above(max_radiance), strict=True)]
        sums.add(band.rays, band.radiance, distances=band.distances, seed=seed, weight=band.weight)
        progress(band.rays.done)
    counts = [int(n[0]) if on_device else int(n) for n in clipped]  # those of a device come down once
    return {name: (stack, n) for name, stack, n in zip(setups, sums.mean_radiance(), counts, strict=True)}


class LitRays(NamedTuple):
    """Camera rays of a band of rows, the distances of their ends, and the radiance that they bring.

    Attributes
    ----------
    rays : CameraRays
        The rays.
    distances : Distances
        Distances of the surfaces that they meet.
    radiance : ndarray of float32, shape (light, ray), or list of Float
        Radiance under each light group.
    weight : array of uint32, shape (ray,), or None
        Number of rays that each ray counts for; None for one each.
    """

    rays: CameraRays
    distances: Distances
    radiance: Any
    weight: Any

    def brightest(self) -> np.ndarray:
        """Return the largest radiance under each light group, float32 (light,)."""
        if isinstance(self.radiance, list):
            return np.array([dr.max(values)[0] for values in self.radiance], dtype=np.float32)
        return self.radiance.max(axis=1, initial=0.0)

    def count_above(self, max_radiance: np.ndarray) -> Iterable[Any]:
        """Return how many rays bring more than ``max_radiance``, for each light group: numbers, or UInt32 to come."""
        if not isinstance(self.radiance, list):
            return np.count_nonzero(self.radiance > max_radiance[:, None], axis=1)
        limits = (dr.opaque(mi.Float64, limit) for limit in max_radiance)
        return [dr.count(mi.Float64(values) > limit) for values, limit in zip(self.radiance, limits, strict=True)]


class TracedBand(NamedTuple):
    """Complete light paths of a band of rows that meet a surface that shares its shading.

    Attributes
    ----------
    done : float
        Fraction of the rows that are done after this band, 0 to 1.
    is_all : bool
        Whether this band holds all paths.
    hits : SurfaceHits
        The surfaces that the paths meet first.
    radiance : ndarray of float32, shape (light, path)
        Radiance that these surfaces send to the lens under each light group.
    ray_count : int
        Number of rays that were cast.
    unshared : int
        Number of rays that met a surface that shares no shading.
    in_light : int
        Number of rays that went straight into light.
    """

    done: float
    is_all: bool
    hits: SurfaceHits
    radiance: np.ndarray
    ray_count: int
    unshared: int
    in_light: int

    def brightest(self) -> np.ndarray:
        """Return the largest radiance under each light group, float32 (light,)."""
        return self.radiance.max(axis=1, initial=0.0)


def _trace_complete_paths(
    setups: Mapping[str, RenderSetup], finder: SurfaceFinder, *, samples: int, seed: int, on_device: bool
) -> Iterator[TracedBand]:
    """Continue the same camera rays under every light group, with different random numbers for each group."""
    first = next(iter(setups.values()))
    travel = np.array(first.travel)
    at_once = backend.bands_at_once() if on_device else 1
    for rays in cast_rays(first, travel, samples=samples, seed=seed, at_once=at_once):
        sight = finder.find(rays, travel, seed=seeds.derive_seed(seed, "lines of sight"), on_device=on_device)
        if on_device:
            arrays, met = cast(Any, sight.hits), cast(Any, sight.hits.shape) > 0
            radiance = [
                _paths_from_device(setup, sight, traced=met, rays=rays, seed=seed, name=name)
                for name, setup in setups.items()
            ]
            shared: Any = dr.compress(met)  # only what is added to cells comes down
            hits = SurfaceHits(*(dr.gather(type(array), array, shared).numpy() for array in arrays))
        else:
            ((begin, _, _),) = rays.bands
            shared = np.flatnonzero(sight.hits.shape).astype(np.uint32)
            radiance = [
                _trace_on(setup, sight, chosen=shared, seed=seeds.derive_seed(seed, name, begin))
                for name, setup in setups.items()
            ]
            hits = SurfaceHits(*(array[shared] for array in sight.hits))
        unshared, in_light = sight.count_unshared(), sight.count_straight_into_light()
        yield TracedBand(
            rays.done, rays.is_only_band, hits, np.stack(radiance), len(sight.unshared), unshared, in_light
        )


def _trace_on(setup: RenderSetup, sight: Sight, *, chosen: np.ndarray, seed: int) -> np.ndarray:
    """Trace chosen rays on from the surfaces that they meet, and return the radiance they bring, float32 (chosen,)."""
    back = np.zeros(chosen.size, dtype=bool) if sight.is_clear_surface is None else sight.is_clear_surface[chosen]
    radiance = np.empty(chosen.size, dtype=np.float32)
    for which, bring in ((~back, trace_radiance), (back, reflected_radiance)):
        if which.any():
            radiance[which] = to_host(bring(setup, pick_rays(sight.segment, chosen[which]), seed=seed))
    return radiance


def _trace_on_device(setup: RenderSetup, sight: Sight, *, chosen: Any, seed: int) -> Any:
    """Return the radiance that chosen rays bring, Float (chosen,); see :func:`_trace_on`."""
    if sight.is_clear_surface is None:
        return finite(trace_radiance(setup, pick_rays(sight.segment, chosen), seed=seed))
    radiance, back = dr.zeros(mi.Float, len(chosen)), dr.gather(mi.Bool, sight.is_clear_surface, chosen)
    for which, bring in ((~back, trace_radiance), (back, reflected_radiance)):
        part: Any = dr.compress(which)
        if len(part):
            rays = pick_rays(sight.segment, dr.gather(mi.UInt32, chosen, part))
            dr.scatter(radiance, finite(bring(setup, rays, seed=seed)), part)
    return radiance


def _trace_bands(
    setup: RenderSetup, sight: Sight, *, traced: Any, rays: CameraRays, seed: int, name: str
) -> Iterator[tuple[Any, Any]]:
    """Yield, for each band, the indices of the rays to trace on, UInt32 (chosen,), and the radiance that they bring."""
    index = dr.arange(mi.UInt32, dr.width(traced))
    for begin, first, end in rays.bands:
        its = traced & (index >= dr.opaque(mi.UInt32, first)) & (index < dr.opaque(mi.UInt32, end))
        chosen: Any = dr.compress(its if len(rays.bands) > 1 else traced)
        if len(chosen):
            yield chosen, _trace_on_device(setup, sight, chosen=chosen, seed=seeds.derive_seed(seed, name, begin))


def _paths_from_device(
    setup: RenderSetup, sight: Sight, *, traced: Any, rays: CameraRays, seed: int, name: str
) -> np.ndarray:
    """Return the radiance that the rays in ``traced`` bring, float32 (chosen,), from the device."""
    bands = _trace_bands(setup, sight, traced=traced, rays=rays, seed=seed, name=name)
    return np.concatenate([np.zeros(0, np.float32), *(light.numpy() for _, light in bands)])


def _brightest(bands: Iterable[LitRays | TracedBand]) -> np.ndarray:
    """Return the largest radiance of all rays for each light group, float64 (light,), or 1.0 if all are dark."""
    largest = np.max([band.brightest() for band in bands], axis=0).astype(np.float64)
    return np.where(largest > 0, largest, 1.0)


def _choose_rays_to_trace_on(
    rays: CameraRays, unshared: np.ndarray, *, rays_per_path: int
) -> tuple[np.ndarray | None, np.ndarray]:
    """Return how many rays each ray counts for (uint32; None for one each), and the indices of the rays to trace on.

    ``unshared``, bool (ray,), marks the rays that meet a surface that shares no shading. Such a ray is traced on if it
    is among the first ``samples / rays_per_path`` rays of its pixel, rounded up. It counts for ``rays_per_path`` rays,
    and the last of them for the remainder.
    """
    if not unshared.any():
        return None, np.empty(0, dtype=np.uint32)
    if rays_per_path == 1:
        return None, np.flatnonzero(unshared).astype(np.uint32)
    traced = -(-rays.samples // rays_per_path)
    sample = rays.sample.numpy()
    weight = np.where(sample < traced, rays_per_path, 0)
    weight[sample == traced - 1] = rays.samples - rays_per_path * (traced - 1)
    weight = np.where(unshared, weight, 1).astype(np.uint32)
    return weight, np.flatnonzero(unshared & (weight > 0)).astype(np.uint32)


def _light_on_device(
    setups: Mapping[str, RenderSetup],
    shading: DeviceField,
    *,
    rays: CameraRays,
    sight: Sight,
    rays_per_path: int,
    seed: int,
) -> LitRays:
    """Return what camera rays bring, without copies to the host; see :func:`render_with_shading`."""
    values = shading.reflect(sight.hits, first=rays.first, seed=seed)
    weight, traced = None, sight.unshared
    any_traced = dr.any(traced)
    if any_traced and rays_per_path > 1:
        count, sample = -(-rays.samples // rays_per_path), rays.sample
        full, rest = (dr.opaque(mi.UInt32, n) for n in (rays_per_path, rays.samples - rays_per_path * (count - 1)))
        last = dr.opaque(mi.UInt32, count - 1)
        weight = dr.select(sample < last, full, dr.select(sample == last, rest, 0))
        weight = dr.select(sight.unshared, weight, 1)
        traced = sight.unshared & (weight > 0)
        dr.eval(weight, traced)
    for n, (name, setup) in enumerate(setups.items()):
        if any_traced:
            for chosen, light in _trace_bands(setup, sight, traced=traced, rays=rays, seed=seed, name=name):
                dr.scatter(values[n], light, chosen)
        if sight.factor is not None:
            values[n] = product(values[n], sight.factor)
        for end in sight.lights:
            light = product(finite(lamp_radiance(setup, pick_rays(end.ray, end.rays))), end.clearness)
            dr.eval(light, values[n])
            dr.scatter(values[n], dr.gather(mi.Float, values[n], end.rays) + light, end.rays)
        if rays.passes is not None:
            values[n] = dr.select(rays.passes, values[n], 0)
    dr.eval(*values)
    return LitRays(rays, sight.distances, values, weight)


class _Sums:
    """Sums of paths for every light group: in layers if there are few positions, otherwise without layers."""

    def __init__(
        self,
        setups: Mapping[str, RenderSetup],
        focus: np.ndarray,
        *,
        samples: int,
        max_radiance: np.ndarray,
        on_device: bool,
    ) -> None:
        self._setup, self._focus = next(iter(setups.values())), focus
        grid, drive = self._setup.grid, self._setup.drive
        shape = (focus.size, grid.rows, grid.columns)
        self._layers = None
        # Layers sort paths by the blur of a perfect lens, and average over it.
        if drive.fills_its_aperture_perfectly and LayeredSums.sums_in_layers(shape, len(setups)):
            scale = np.array(
                [one_pass.fixed_point_scale(self._setup, focus, samples=samples, max_radiance=m) for m in max_radiance]
            )
            blur = BlurScale.from_drive(drive, focus, pitch_m=grid.pitch_m)
            layers = DeviceLayeredSums if on_device else LayeredSums
            self._layers = layers(shape, blur=blur, scale=scale, max_radiance=max_radiance)
        else:
            self._single = [
                one_pass.start_sums(
                    setup, focus, samples=samples, max_radiance=m, stacks=len(setups), on_device=on_device
                )
                for setup, m in zip(setups.values(), max_radiance, strict=True)
            ]

    def add(self, rays: CameraRays, radiance: Any, *, distances: Distances, seed: int, weight: Any) -> None:
        """Add rays, cast with this seed, and the radiance that they bring under each group, float32 (light, ray)."""
        line = land_on_sensor(rays, self._setup, focus=self._focus, seed=seed)
        radius = self._setup.drive.aperture_radius_m
        lens = rays.lens.x / radius, rays.lens.y / radius
        dr.eval(*(array for array in line if array is not None), *lens)
        if isinstance(self._layers, DeviceLayeredSums):
            self._layers.add(line._replace(weight=weight), radiance, lens=lens, distances=distances)
            return
        if self._layers is not None:
            line = line.to_host()._replace(weight=weight)
            on_lens = lens[0].numpy(), lens[1].numpy()
            self._layers.add(line, radiance, lens=on_lens, distances=distances)
            return
        weights = None if weight is None else mi.UInt32(weight)
        for sums, values in zip(self._single, radiance, strict=True):
            sums.add(line._replace(radiance=mi.Float(values), weight=weights))

    def mean_radiance(self) -> Iterable[np.ndarray]:
        """Return the mean radiance for each group, float32 (focus, row, col)."""
        if self._layers is not None:
            return self._layers.mean_radiance()
        return [sums.mean_radiance() for sums in self._single]
