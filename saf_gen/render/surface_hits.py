"""Finds the surface whose light a camera ray brings, behind clear surfaces, and whether it may share its shading.

A surface shares shading if it sends to the lens the product of the light that falls on it, which changes slowly, and
its reflectance, which is its texture. Polished metal or a varnished blend does not, so rays that end there are traced
on. A black lamp and the sky reflect nothing, and their emission is known for every ray. Rays look through clear
surfaces (:mod:`saf_gen.render.line_of_sight`).
"""

from collections.abc import Collection
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.render.camera_rays import CameraRays, opaque
from saf_gen.render.line_of_sight import OPAQUE, ClearSurfaces, number_shapes, through_glass
from saf_gen.render.meshes import has_own_attributes
from saf_gen.render.render_setup import RenderSetup
from saf_gen.render.shading_cells import SurfaceHits

CELL_DEPTH = 16.0  # depth of a smallest cell divided by the width of a pixel at its distance
TEXTURE_KEYS = (".data", ".color0", ".color0.value")  # of a bitmap, and of a checkerboard
UNSHARED_FLAGS = mi.BSDFFlags.Delta | mi.BSDFFlags.Delta1D
MIN_CHANCE = 0.05  # smallest reflectance with which a surface at the end of a line is drawn among others
MAX_PIXELS_FROM_ORIGIN = 2000  # surfaces whose column or row is farther than this from 0 share no shading


class Distances(NamedTuple):
    """Axial distances (m) of the surfaces on lines of sight, from the lens at the middle position, float32 (ray,).

    Attributes
    ----------
    end : ndarray or Float
        Distance of the end: inf if there is nothing, 0 if the line was bent.
    nearest, farthest : ndarray, Float or None
        Distances of the clear surfaces in front of the end, inf and 0 if there are none; None if the scene has no clear
        surface.
    """

    end: Any
    nearest: Any = None
    farthest: Any = None


class EndsInLight(NamedTuple):
    """Lines of sight that end in a black lamp or the sky.

    Attributes
    ----------
    rays : ndarray of uint32, or UInt32, shape (end,)
        Indices of their camera rays.
    ray : Ray3f
        Last parts of all lines, as Dr.Jit arrays (ray,).
    clearness : ndarray of float32, or Float, shape (end,)
        Fraction of the light at the end that reaches the lens.
    """

    rays: Any
    ray: Any
    clearness: Any


class Sight(NamedTuple):
    """Surfaces that camera rays see, as numpy arrays (ray,), or as Dr.Jit arrays if they stay on the device.

    Attributes
    ----------
    hits : SurfaceHits
        Surfaces whose reflected light counts; ``shape`` is 0 if a surface shares no shading.
    unshared : array of bool
        Whether the ray must be traced on for the reflected light.
    factor : array of float32, or None
        Fraction of the reflected light that reaches the lens; None for all of it.
    segment : Ray3f
        Parts of the lines of sight that meet the surfaces in ``hits``, as Dr.Jit arrays.
    is_clear_surface : array of bool, or None
        Whether the surface in ``hits`` is clear; None if the scene has no clear surface.
    lights : tuple of EndsInLight
        Ends of lines in a black lamp or the sky.
    distances : Distances
        Distances of the surfaces that the lines meet.
    """

    hits: SurfaceHits
    unshared: Any
    factor: Any
    segment: Any
    is_clear_surface: Any
    lights: tuple[EndsInLight, ...]
    distances: Distances

    def count_straight_into_light(self) -> int:
        """Return how many rays end in light without a bend."""
        if isinstance(self.unshared, np.ndarray):
            return sum(int(np.count_nonzero(self.distances.end[end.rays] > 0)) for end in self.lights)
        ends = [dr.gather(mi.Float, self.distances.end, end.rays) for end in self.lights]
        counts: list[Any] = [dr.count(end > 0) for end in ends]
        return sum(int(count[0]) for count in counts)

    def count_unshared(self) -> int:
        """Return how many rays meet a surface that shares no shading."""
        if isinstance(self.unshared, np.ndarray):
            return int(np.count_nonzero(self.unshared))
        count: Any = dr.count(self.unshared)
        return int(count[0])


class SurfaceFinder:
    """Finds the surfaces that camera rays see in one scene.

    A point on a moving shape gets the position that it would have if the shape had not moved (rotation is ignored), so
    that shading found at different moments stays on the shape.

    Parameters
    ----------
    setup : RenderSetup
        Scene in front of its lens.
    emitting : collection of str
        Ids of the shapes that are lamps under any light group, whether lit in this scene or not.
    """

    def __init__(self, setup: RenderSetup, *, emitting: Collection[str]) -> None:
        self._setup = setup
        drive, grid = setup.drive, setup.grid
        self._middle = float(drive.shift(0.5))
        self._pixels_per_slope = float(drive.image_distance(0.5)) / grid.pitch_m
        shapes = {_registry_index(shape): shape for shape in setup.mitsuba_scene.shapes()}
        lamps = {index for index, shape in shapes.items() if shape.id() in emitting or shape.is_emitter()}
        size = max(shapes, default=0) + 1
        self._clear = ClearSurfaces({i: shape for i, shape in shapes.items() if i not in lamps}, size=size)
        number, textured, black = (np.zeros(size, dtype=np.uint32) for _ in range(3))
        for n, (index, shape) in enumerate(shapes.items(), start=1):
            if index in lamps:
                black[index] = int(shape.bsdf().flags()) & int(mi.BSDFFlags.All) == int(mi.BSDFFlags.DiffuseReflection)
            elif _can_share_shading(shape.bsdf()):
                number[index] = 2 * n + bool(int(shape.bsdf().flags()) & int(mi.BSDFFlags.Glossy))
                textured[index] = bool(int(shape.bsdf().flags()) & int(mi.BSDFFlags.Null)) or _is_textured(shape)
        self._number: Any = mi.UInt32(number)
        self._textured: Any = mi.UInt32(textured)
        self._black: Any = mi.UInt32(black)  # lamps that reflect nothing if their reflectance is 0
        moved = np.zeros((size, 3), dtype=np.float32)
        for index, shape in shapes.items():
            moved[index] = setup.moved_m.get(shape.id(), np.zeros(3)) / setup.unit_m
        self._moved: Any = mi.Float(moved.ravel())  # read three at a time

    def find(self, rays: CameraRays, focus: np.ndarray, *, seed: int, on_device: bool = False) -> Sight:
        """Follow rays, cast for these positions, to the surfaces that they see; ``seed`` is for choices on the way.

        With ``on_device``, what is found stays on the device, as Dr.Jit arrays; without, it is numpy arrays.
        """
        setup, scene = self._setup, self._setup.mitsuba_scene
        to_camera = mi.Transform4f(setup.to_world).inverse()
        begin = opaque(setup.drive.shift(float(focus[0] + focus[-1]) / 2))

        def axial(point: Any) -> Any:
            return (to_camera @ point).z * setup.unit_m - begin

        line = None
        last = segment = mi.Ray3f(rays.ray)
        if self._clear.any:
            line = through_glass(scene, last, self._clear, axial=axial, seed=seed, first=rays.first)
            dr.eval(*line)  # field by field: dr.eval does not evaluate a named tuple
            last = line.last
        hit = scene.ray_intersect(last)
        valid = hit.is_valid()
        distance = dr.select(valid, axial(hit.p), dr.inf)
        in_light, chance = self._at_end(hit, valid)
        factor = dr.select(in_light, mi.Float(0), 1.0)
        lights = [(in_light, last, mi.Float(1))]
        if line is not None:
            distance = dr.select(line.straight, distance, 0)
            has_branch = line.branch_fraction > 0
            branch_hit = scene.ray_intersect(line.branch, has_branch)
            branch_in_light, branch_chance = self._at_end(branch_hit, has_branch & branch_hit.is_valid())
            lights = [
                (in_light, last, line.clearness),
                (branch_in_light & has_branch, line.branch, line.branch_fraction),
            ]
            at_end, at_branch = line.clearness * chance, line.branch_fraction * branch_chance
            total = at_end + at_branch + line.reflected_fraction
            # A draw of 0 must not choose a surface whose chance is 0.
            is_end = line.draw * total < at_end
            is_clear = line.draw * total >= at_end + at_branch
            segment = dr.select(is_end, last, dr.select(is_clear, line.segment, line.branch))
            weight = dr.select(is_end, 1 / chance, dr.select(is_clear, line.reflection_weight, 1 / branch_chance))
            factor = dr.select(total > 0, total * weight, 0)
            dr.eval(segment, factor, is_clear, distance, lights)
            hit = scene.ray_intersect(segment)
            valid = hit.is_valid()
        counts = valid & (factor > 0)
        shape: Any = dr.select(counts, self._look_up(self._number, hit, valid=counts), 0)
        if line is not None:
            # A clear surface shares only the light that it reflects, and only if it reflects none like a mirror.
            clear = self._clear.effect_on_line(hit, counts) != OPAQUE
            shape = dr.select(clear & (~is_clear | self._clear.mirrors(hit, counts & is_clear)), 0, shape)
        # Shading moves along with a shape.
        moved = dr.gather(mi.Vector3f, self._moved, number_shapes(hit), valid)
        point = (to_camera @ mi.Point3f(hit.p - moved)) * setup.unit_m
        depth = point.z - opaque(self._middle)  # from the lens at the middle of its travel, for all rays alike
        scale = opaque(self._pixels_per_slope)
        column = -point.x / depth * scale + opaque(setup.grid.columns / 2)
        row = -point.y / depth * scale + opaque(setup.grid.rows / 2)
        # Column, row and depth are nan for rays that meet nothing; their shape is 0, and they have no cell.
        out_of_range = dr.maximum(dr.abs(column), dr.abs(row)) > MAX_PIXELS_FROM_ORIGIN
        shape = dr.select((depth <= 0) | out_of_range, 0, shape)  # a depth below 0 is seen in a mirror
        textured = (shape > 0) & (self._look_up(self._textured, hit, valid=shape > 0) > 0)
        normal = dr.normalize(mi.Vector3f(to_camera @ mi.Normal3f(hit.sh_frame.n)))
        normal = dr.select(hit.wi.z < 0, -normal, normal)  # the side that is seen
        u, v = _octahedral(normal)
        hits: list[Any] = [
            shape,
            column,
            row,
            dr.log(dr.maximum(depth, 1e-9)) * opaque(self._pixels_per_slope / CELL_DEPTH),
            u,
            v,
            dr.select(textured, _reflectance(hit, textured), 1.0),
        ]
        unshared = counts & (shape == 0)
        dr.eval(hits, factor, unshared, distance, lights)

        def bring(array: Any) -> Any:
            return array if on_device else array.numpy()

        find_ends = _ends_on_device if on_device else _ends_in_light
        found = SurfaceHits(*map(bring, hits))
        every = (find_ends(lit, ray, clearness=fraction) for lit, ray, fraction in lights)
        ends = tuple(end for end in every if len(end.rays))
        if line is None:
            return Sight(found, bring(unshared), None, segment, None, ends, Distances(bring(distance)))
        distances = Distances(bring(distance), bring(line.nearest), bring(line.farthest))
        return Sight(found, bring(unshared), bring(factor), segment, bring(is_clear), ends, distances)

    def _at_end(self, hit: Any, valid: Any) -> tuple[Any, Any]:
        """Return whether lines end in a black lamp or the sky, and if not, how much light the surface may reflect.

        The latter, 0 to 1, determines how often this light is sampled.
        """
        lamp = self._look_up(self._black, hit, valid=valid) > 0
        shares = self._look_up(self._number, hit, valid=valid) > 0
        if self._clear.any:
            shares &= self._clear.effect_on_line(hit, valid) == OPAQUE
        in_light = ~valid | (lamp & (_reflectance(hit, lamp) == 0))
        reflected = dr.clip(_reflectance(hit, shares), MIN_CHANCE, 1)  # not evaluated if lines have no choice
        return in_light, dr.select(in_light, 0, dr.select(shares, reflected, 1))

    def _look_up(self, table: Any, hit: Any, *, valid: Any) -> Any:
        """Return the entries of a table for the shapes that rays hit, UInt32 (ray,)."""
        return dr.gather(mi.UInt32, table, number_shapes(hit), valid)


def _ends_in_light(in_light: Any, ray: Any, *, clearness: Any) -> EndsInLight:
    rays = np.flatnonzero(in_light.numpy()).astype(np.uint32)
    fraction = clearness.numpy()
    return EndsInLight(rays, ray, fraction[rays] if fraction.size > 1 else np.ones(rays.size, dtype=np.float32))


def _ends_on_device(in_light: Any, ray: Any, *, clearness: Any) -> EndsInLight:
    rays: Any = dr.compress(in_light)
    return EndsInLight(rays, ray, dr.gather(mi.Float, clearness, rays) if len(clearness) > 1 else mi.Float(1))


def _reflectance(hit: Any, active: Any) -> Any:
    """Return the fraction of light that surfaces reflect alike in all directions; 0 for rays not in ``active``.

    It is 0 where a picture from a file is nan, too.
    """
    return dr.select(active, dr.fmax(hit.bsdf().eval_diffuse_reflectance(hit, active).x, 0), 0)


def _octahedral(normal: Any) -> tuple[Any, Any]:
    """Return a direction on the octahedral map, as two coordinates from 0 to 1."""
    total = dr.abs(normal.x) + dr.abs(normal.y) + dr.abs(normal.z)
    x, y = normal.x / total, normal.y / total
    folded_x, folded_y = dr.copysign(1 - dr.abs(y), x), dr.copysign(1 - dr.abs(x), y)
    back = normal.z < 0
    return dr.select(back, folded_x, x) / 2 + 0.5, dr.select(back, folded_y, y) / 2 + 0.5


def _registry_index(shape: Any) -> int:
    """Return the number that a pointer to this shape has in a kernel."""
    return int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0])


def _can_share_shading(bsdf: Any) -> bool:
    flags = int(bsdf.flags())
    glossy = flags & int(mi.BSDFFlags.Glossy)
    if flags & int(mi.BSDFFlags.Null):  # unless it reflects like a mirror: see ClearSurfaces.mirrors
        return bool(flags & int(mi.BSDFFlags.Diffuse)) and not glossy
    if "Blend" in str(bsdf) and glossy:
        return False  # Mitsuba gives no reflectance of a blend without its highlights
    return not flags & int(UNSHARED_FLAGS) and bool(flags & int(mi.BSDFFlags.Diffuse))


def _is_textured(shape: Any) -> bool:
    """Return whether a shape's reflectance varies over it; if not, the radiance need not be divided by it."""
    bitmaps = any(key.endswith(TEXTURE_KEYS) for key in mi.traverse(shape.bsdf()).keys())  # noqa: SIM118
    return bitmaps or has_own_attributes(shape)
