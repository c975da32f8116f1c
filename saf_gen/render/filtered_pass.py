"""A focal stack with finer grain than its light paths have: shading is shared, visibility and texture are not.

Most of the noise of a traced picture comes from the light that a path finds, by chance, where it meets a surface; the
rest from which bit of texture is seen through which part of the lens. So both are sampled on their own:

1. whole light paths, under each light group, tell the shading of the surfaces that camera rays meet first
   (:mod:`saf_gen.render.shading_cells`). They start evenly over all of the travel, so that what they tell does not
   depend on where the lens is;
2. PRIMARY_RAYS times as many camera rays, the same for all groups, are traced to their first surface only. Each brings
   the reflectance there times the shading that the cells know.

A ray looks through what is clear (:mod:`saf_gen.render.line_of_sight`). Where it ends at a surface which cannot share
shading (:mod:`saf_gen.render.surface_hits`), it is traced on, one in PRIMARY_RAYS of them, and counts for all.

A moving scene is rendered at many moments. Shading that stays where it is from one to the next is told by the paths of
MOMENTS of them, a quarter as many each; what has changed since is found by the latest alone, where it shows above
the noise.

The result has a bias where shading changes within a cell, which falls as samples grow: see
docs/explanation/shared-shading.md.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.core import seeds
from saf_gen.render import one_pass
from saf_gen.render.camera_rays import CameraRays, cast_camera_rays, land_rays_on_sensor
from saf_gen.render.layered_splat import MOST_POSITIONS, BlurScale, LayeredSums
from saf_gen.render.render_setup import RenderSetup, positions_to_render
from saf_gen.render.shading_cells import CellTable, ShadingCells, ShadingField, SurfaceHits
from saf_gen.render.surface_hits import Distances, Sight, SurfaceFinder
from saf_gen.render.traced_light import pick_rays, read_radiance_of_lamps, trace_radiance, trace_radiance_thrown_back

PRIMARY_RAYS = 6  # per light path
RAYS_INTO_LIGHT = 3  # the same in layers where most rays end straight in light: only texture is left to chance
UNSHARED_PATHS = 2  # light paths per requested one where most must be traced on
WHOLE_TRAVEL = np.array([0.0, 1.0])


def gather_shading(
    setups: Mapping[str, RenderSetup],
    *,
    samples: int,
    seed: int,
    emitting: Collection[str] = (),
    progress: Callable[[float], None] = lambda done: None,
) -> ShadingCells:
    """Trace whole light paths of a scene's light groups, and return what they tell about the shading of its surfaces.

    Needs a JIT backend (llvm or cuda). What a group's paths tell does not depend on which others are traced.

    Parameters
    ----------
    setups : the same scene under each light group, by name.
    samples : light paths per pixel and light group, at least.
    seed : seed of the paths.
    emitting : ids of the shapes that are lamps under any group of the scene.
    progress : called with the fraction done, 0...1.
    """
    finder = SurfaceFinder(next(iter(setups.values())), emitting=emitting)
    bands = _trace_whole_paths(setups, finder, samples=samples, seed=seed)
    opening = next(bands)
    most = _brightest([opening], setups)
    if opening.done < 1:  # brighter paths than 64 times the brightest at one sample per pixel are fireflies
        trial = _trace_whole_paths(setups, finder, samples=1, seed=seeds.derive_seed(seed, "trial"))
        most = {name: 64 * value for name, value in _brightest(trial, setups).items()}
    cells = CellTable(len(setups))
    for band in chain([opening], bands):
        cells.add(band.hits, np.stack([np.minimum(band.radiance[name], np.float32(most[name])) for name in setups]))
        cells.count_rays(band.rays, unshared=band.alone, in_light=band.in_light)
        progress(band.done)
    return cells.by_tile()


def estimate_shading(moments: Sequence[ShadingCells]) -> ShadingField:
    """Return the shading at the last of some moments, from what the paths of all of them tell."""
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
    setups : the same scene under each light group, by name.
    shading : the shading of its surfaces under each of these groups, in their order.
    samples : PRIMARY_RAYS (or RAYS_INTO_LIGHT) times as many camera rays per pixel and position, at least, of which
        ``samples`` are traced on where they meet a surface that shares no shading; UNSHARED_PATHS times as many, all
        traced on, where most surfaces share none.
    emitting : ids of the shapes that are lamps under any group of the scene.
    positions, seed, window, progress, on_device : see :func:`saf_gen.render.one_pass.render_stack`.

    Returns
    -------
    For each group the stack, float32 (focus, row, col), and the number of light paths that were clipped as fireflies.
    """
    focus = positions_to_render(positions, window)
    first = next(iter(setups.values()))
    finder = SurfaceFinder(first, emitting=emitting)
    rays_per_path = 1  # where little is shared, rays that are not traced on would tell little
    if shading.unshared < 0.5:
        blurred = focus.size <= MOST_POSITIONS  # summed in layers, which average over blur
        rays_per_path = RAYS_INTO_LIGHT if blurred and shading.in_light > 0.5 else PRIMARY_RAYS
    samples *= rays_per_path if rays_per_path > 1 else UNSHARED_PATHS

    def bring_light(samples: int, seed: int) -> Iterator[LitRays]:
        for rays in cast_camera_rays(first, focus, samples=samples, seed=seed):
            sight = finder.find(rays, focus, seed=seeds.derive_seed(seed, "lines of sight"))
            values = shading.reflect(sight.hits, first=rays.first, seed=seed)
            weight, chosen = _choose_rays_to_trace_on(rays, sight.alone, rays_per_path=rays_per_path)
            for n, (name, setup) in enumerate(setups.items()):
                if chosen.size:
                    values[n, chosen] = _trace_on(
                        setup, sight, chosen=chosen, seed=seeds.derive_seed(seed, name, rays.begin)
                    )
                if sight.factor is not None:
                    values[n] *= sight.factor
                for end in sight.lights:
                    values[n, end.rays] += read_radiance_of_lamps(setup, pick_rays(end.ray, end.rays)) * end.clearness
            yield LitRays(rays, sight.distances, values, weight)

    bands = bring_light(samples, seed)
    opening = next(bands)
    most = _brightest_rays([opening])
    if opening.rays.done < 1:  # as in a plain stack: of all of the picture, not of its first rows
        most = 64 * _brightest_rays(bring_light(1, seeds.derive_seed(seed, "trial")))
    sums = _Sums(setups, focus, samples=samples, most=most, on_device=on_device)
    clipped = np.zeros(len(setups), dtype=int)
    for band in chain([opening], bands):
        clipped += np.count_nonzero(band.radiance > most[:, None], axis=1)
        sums.add(band.rays, band.radiance, distances=band.distances, seed=seed, weight=band.weight)
        progress(band.rays.done)
    return {name: (stack, int(n)) for name, stack, n in zip(setups, sums.mean_radiance(), clipped, strict=True)}


class LitRays(NamedTuple):
    """Camera rays of a band of rows, where they end, and what they bring.

    distances : see :class:`saf_gen.render.surface_hits.Sight`. radiance : float32 (light, ray).
    weight : how many rays each counts for, uint32 (ray,); None for one each.
    """

    rays: CameraRays
    distances: Distances
    radiance: np.ndarray
    weight: np.ndarray | None


def _brightest_rays(bands: Iterable[LitRays]) -> np.ndarray:
    """Return the largest radiance of all rays for each light group, float64 (light,), or 1.0 where all are dark."""
    most = np.max([band.radiance.max(axis=1) for band in bands], axis=0).astype(np.float64)
    return np.where(most > 0, most, 1.0)


class WholePaths(NamedTuple):
    """Whole light paths of a band of rows that meet a surface which shares its shading.

    hits : these surfaces. radiance : that they send to the lens under each light group, float32 (path,).
    rays, alone, in_light : how many rays were cast, how many of them met a surface that shares no shading, and how many
        went straight into light.
    """

    done: float
    hits: SurfaceHits
    radiance: dict[str, np.ndarray]
    rays: int
    alone: int
    in_light: int


def _trace_whole_paths(
    setups: Mapping[str, RenderSetup], finder: SurfaceFinder, *, samples: int, seed: int
) -> Iterator[WholePaths]:
    """Trace the same camera rays on under every light group; the random numbers behind them are each group's own."""
    for rays in cast_camera_rays(next(iter(setups.values())), WHOLE_TRAVEL, samples=samples, seed=seed):
        sight = finder.find(rays, WHOLE_TRAVEL, seed=seeds.derive_seed(seed, "lines of sight"))
        shares = np.flatnonzero(sight.hits.shape).astype(np.uint32)
        radiance = {
            name: _trace_on(setup, sight, chosen=shares, seed=seeds.derive_seed(seed, name, rays.begin))
            for name, setup in setups.items()
        }
        hits = SurfaceHits(*(array[shares] for array in sight.hits))
        alone, in_light = int(np.count_nonzero(sight.alone)), sight.count_straight_into_light()
        yield WholePaths(rays.done, hits, radiance, sight.alone.size, alone, in_light)


def _trace_on(setup: RenderSetup, sight: Sight, *, chosen: np.ndarray, seed: int) -> np.ndarray:
    """Return the radiance of the surfaces whose light some of the rays bring, traced on, float32 (chosen,)."""
    back = np.zeros(chosen.size, dtype=bool) if sight.thrown_back is None else sight.thrown_back[chosen]
    radiance = np.empty(chosen.size, dtype=np.float32)
    for which, bring in ((~back, trace_radiance), (back, trace_radiance_thrown_back)):
        if which.any():
            radiance[which] = bring(setup, pick_rays(sight.segment, chosen[which]), seed=seed)
    return radiance


def _brightest(bands: Iterable[WholePaths], names: Iterable[str]) -> dict[str, float]:
    """Return the largest radiance of all paths for each light group, or 1.0 where all are dark."""
    most = dict.fromkeys(names, 0.0)
    for band in bands:
        most = {name: max(value, float(band.radiance[name].max(initial=0.0))) for name, value in most.items()}
    return {name: value or 1.0 for name, value in most.items()}


def _choose_rays_to_trace_on(
    rays: CameraRays, alone: np.ndarray, *, rays_per_path: int
) -> tuple[np.ndarray | None, np.ndarray]:
    """Return how many rays each ray counts for, uint32 or None for one each, and the indices of those to trace on.

    ``alone`` are those that meet a surface which shares no shading, bool (ray,). They are taken from the first of a
    pixel's: one for each ``rays_per_path``, the last for what is left.
    """
    if not alone.any():
        return None, np.empty(0, dtype=np.uint32)
    if rays_per_path == 1:
        return None, np.flatnonzero(alone).astype(np.uint32)
    traced = -(-rays.samples // rays_per_path)
    sample = rays.sample.numpy()
    weight = np.where(sample < traced, rays_per_path, 0)
    weight[sample == traced - 1] = rays.samples - rays_per_path * (traced - 1)
    weight = np.where(alone, weight, 1).astype(np.uint32)
    return weight, np.flatnonzero(alone & (weight > 0)).astype(np.uint32)


class _Sums:
    """Sums of paths for every light group: in layers where there are few positions, else all together."""

    def __init__(
        self,
        setups: Mapping[str, RenderSetup],
        focus: np.ndarray,
        *,
        samples: int,
        most: np.ndarray,
        on_device: bool | None,
    ) -> None:
        self._setup, self._focus = next(iter(setups.values())), focus
        grid, drive = self._setup.grid, self._setup.drive
        shape = (focus.size, grid.rows, grid.columns)
        self._layers = None
        if LayeredSums.has_room(shape, len(setups)):
            scale = np.array(
                [one_pass.fixed_point_scale_of_splat(self._setup, focus, samples=samples, most=m) for m in most]
            )
            blur = BlurScale.from_drive(drive, focus, pitch_m=grid.pitch_m)
            self._layers = LayeredSums(shape, blur=blur, scale=scale, most=most)
        else:
            self._single = [
                one_pass.start_radiance_sums(
                    setup, focus, samples=samples, most=m, stacks=len(setups), on_device=on_device
                )
                for setup, m in zip(setups.values(), most, strict=True)
            ]

    def add(
        self, rays: CameraRays, radiance: np.ndarray, *, distances: Distances, seed: int, weight: np.ndarray | None
    ) -> None:
        """Add rays, cast with this seed, with the radiance that they bring under each group, float32 (light, ray)."""
        line = land_rays_on_sensor(rays, self._setup, focus=self._focus, seed=seed)
        radius = self._setup.drive.aperture_radius_m
        lens = rays.lens.x / radius, rays.lens.y / radius
        dr.eval(*(array for array in line if array is not None), *lens)
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
