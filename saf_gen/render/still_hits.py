"""Camera hits of what stands still, traced once for all time slices that are rendered at the same positions.

Such slices have the same camera rays (:mod:`saf_gen.render.camera_rays`), and most rays meet nothing that moves. The
first of these slices traces all rays against a scene of the still surfaces alone, and keeps what they meet. In each
slice, rays are tested against a scene of the movers alone, which takes a twentieth of the time. Only a ray that meets a
mover on its way, or a mover nearly at its still surface, is traced again in the scene of the moment. A ray thus meets
the same surface at the same point as if all were traced again, and no bit of a picture changes.

Shading is not kept: a ray that meets no mover may end in the shadow of one.
"""

from collections.abc import Collection
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.render.camera_rays import CameraRays, opaque, pick_rays
from saf_gen.render.render_setup import RenderSetup
from saf_gen.render.shading_cells import SurfaceHits
from saf_gen.render.surface_hits import Distances, EndsInLight, Sight, SurfaceFinder

MAX_BYTES = 1 << 30  # of kept hits; bands of rows beyond it are traced anew in each slice
REACH = 1.01  # a mover counts as met up to this far beyond the still surface, in distances of that surface


class _Kept(NamedTuple):
    """What the rays of a band meet in the still scene: 33 bytes a ray."""

    hits: SurfaceHits
    unshared: np.ndarray
    in_light: np.ndarray
    distance: np.ndarray

    @property
    def size_bytes(self) -> int:
        return sum(array.nbytes for array in (*self.hits, self.unshared, self.in_light, self.distance))


class StillHits:
    """What camera rays meet in a scene without its movers, for one window of positions at a time.

    Parameters
    ----------
    still : RenderSetup
        The scene without what moves.
    emitting : collection of str
        Ids of the shapes that are lamps under any light group.
    """

    def __init__(self, still: RenderSetup, *, emitting: Collection[str]) -> None:
        self._still, self._emitting = still, emitting
        self._finder = SurfaceFinder(still, emitting=emitting)
        self._window: tuple[int, int] | None = None  # None also stands for the travel
        self._kept: dict[tuple[int, int], _Kept] = {}

    def finder(
        self, whole: RenderSetup, movers: Any, *, window: tuple[int, int] | None
    ) -> "MovingFinder | SurfaceFinder":
        """Return what finds the surfaces of a moment that camera rays see.

        Parameters
        ----------
        whole : RenderSetup
            The scene at the moment.
        movers : mi.Scene
            Only what moves, at the same moment.
        window : tuple of int or None
            Positions of the slice. What was kept for other positions is dropped.
        """
        if window != self._window:
            self._window, self._kept = window, {}
        finder = SurfaceFinder(whole, emitting=self._emitting)
        ids, still, moving = (
            [shape.id() for shape in scene.shapes()]
            for scene in (whole.mitsuba_scene, self._still.mitsuba_scene, movers)
        )
        # A line through clear surfaces may meet a mover behind any bend, and instances show others' shapes.
        mixed = finder.sees_through_some or any(s.class_name() == "Instance" for s in whole.mitsuba_scene.shapes())
        named = len({*ids}) == len(ids) and sorted(ids) == sorted(still + moving)
        if mixed or not (named and still and moving):
            return finder
        number = np.array([0] + [ids.index(name) + 1 for name in still], dtype=np.uint32)
        return MovingFinder(self, finder, movers, number=number)

    def trace(self, rays: CameraRays, focus: np.ndarray, *, seed: int, number: np.ndarray) -> _Kept | None:
        """Return what the rays of a band meet in the still scene; None if there is no room to keep it.

        ``number`` holds the number in the whole scene of each shape of the still scene, both counted from 1.
        """
        ((begin, _, _),) = rays.bands
        key = seed, begin
        if key not in self._kept:
            if sum(kept.size_bytes for kept in self._kept.values()) + 33 * dr.width(rays.ray.o) > MAX_BYTES:
                return None
            sight = self._finder.find(rays, focus, seed=seed)
            in_light = np.zeros(sight.unshared.size, dtype=bool)
            for end in sight.lights:
                in_light[end.rays] = True
            shape = 2 * number[sight.hits.shape >> 1] + (sight.hits.shape & 1)
            self._kept[key] = _Kept(sight.hits._replace(shape=shape), sight.unshared, in_light, sight.distances.end)
        return self._kept[key]

    def test(self, movers: Any, rays: CameraRays, *, focus: np.ndarray, distance: np.ndarray) -> np.ndarray:
        """Return the indices of the rays that meet a mover up to these axial distances (m), uint32."""
        setup = self._still
        to_camera, unit = mi.Transform4f(setup.to_world).inverse(), opaque(setup.unit_m)
        begin = opaque(setup.drive.shift(float(focus[0] + focus[-1]) / 2))
        ray = mi.Ray3f(rays.ray)
        origin, along = (to_camera @ ray.o).z * unit, (to_camera @ ray.d).z * unit
        reach = (mi.Float(distance) + begin - origin) / along * REACH
        ray.maxt = dr.select(dr.isfinite(reach), reach, dr.largest(mi.Float))
        return np.flatnonzero(movers.ray_test(ray).numpy()).astype(np.uint32)


class MovingFinder:
    """Finds the surfaces of one moment that camera rays see, like :class:`SurfaceFinder`, and traces only some rays."""

    def __init__(self, still: StillHits, whole: SurfaceFinder, movers: Any, *, number: np.ndarray) -> None:
        self._still, self._whole, self._movers, self._number = still, whole, movers, number

    def find(self, rays: CameraRays, focus: np.ndarray, *, seed: int, on_device: bool = False) -> Sight:
        """See :meth:`SurfaceFinder.find`; on a device all rays are traced, because that takes less time than copies."""
        if on_device:
            return self._whole.find(rays, focus, seed=seed, on_device=True)
        ray = mi.Ray3f(rays.ray)
        dr.eval(ray)
        kept = self._still.trace(rays, focus, seed=seed, number=self._number)
        if kept is None:
            return self._whole.find(rays, focus, seed=seed)
        again = self._still.test(self._movers, rays, focus=focus, distance=kept.distance)
        hits, unshared, in_light, distance = kept
        if again.size:
            moved = self._whole.find(rays._replace(ray=pick_rays(ray, again)), focus, seed=seed)
            hits = SurfaceHits(*(_replaced(old, new, at=again) for old, new in zip(hits, moved.hits, strict=True)))
            lit = np.zeros(again.size, dtype=bool)
            for end in moved.lights:
                lit[end.rays] = True
            unshared = _replaced(unshared, moved.unshared, at=again)
            in_light = _replaced(in_light, lit, at=again)
            distance = _replaced(distance, moved.distances.end, at=again)
        ends = np.flatnonzero(in_light).astype(np.uint32)
        lights = (EndsInLight(ends, ray, np.ones(ends.size, dtype=np.float32)),) if ends.size else ()
        return Sight(hits, unshared, None, ray, None, lights, Distances(distance))


def _replaced(array: np.ndarray, values: np.ndarray, *, at: np.ndarray) -> np.ndarray:
    """Return a copy of an array with other values at some indices."""
    copy = array.copy()
    copy[at] = values
    return copy
