"""Which surface's light a camera ray brings, behind what clear ones, and whether that surface may share its shading.

A surface shares shading if the light that it sends to the lens is the product of what falls on it, which changes
slowly, and of a reflectance, which is its texture. So a polished metal does not, nor a varnished blend: rays that end
there are traced on. A black lamp and the sky reflect nothing: what they send is known to every ray. What is clear is
looked through (:mod:`saf_gen.render.line_of_sight`).
"""

from collections.abc import Collection
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.render.camera_rays import CameraRays, opaque_number_for_rays
from saf_gen.render.line_of_sight import OPAQUE, ClearSurfaces, follow_rays_through_glass, number_shapes_that_rays_hit
from saf_gen.render.render_setup import RenderSetup
from saf_gen.render.shading_cells import SurfaceHits

CELL_DEPTH = 16.0  # depth of a smallest cell over the width of a pixel at its distance
GEOMETRY_ATTRIBUTES = {"vertex_positions", "vertex_normals", "vertex_texcoords"}
TEXTURE_KEYS = (".data", ".color0", ".color0.value")  # of a bitmap, and of a checkerboard
UNSHARED_FLAGS = mi.BSDFFlags.Delta | mi.BSDFFlags.Delta1D
LEAST_CHANCE = 0.05  # of the reflectance of a surface at the end of a line that has others to choose from
PIXELS_BESIDE = 2000  # how far beside the picture surfaces share shading


class Distances(NamedTuple):
    """Axial distances (m) of what lines of sight meet, from the lens at the middle position, float32 (ray,).

    end : inf where there is nothing, 0 where the line was bent. nearest, farthest : of the clear surfaces before the
    end, inf and 0 where there is none; None where the scene has none.
    """

    end: np.ndarray
    nearest: np.ndarray | None = None
    farthest: np.ndarray | None = None


class EndsInLight(NamedTuple):
    """Lines of sight that end in a black lamp or the sky.

    rays : uint32 (end,), indices of their camera rays. ray : Dr.Jit's rays (ray,), the last parts of all lines.
    clearness : float32 (end,), how much of the light at the end reaches the lens.
    """

    rays: np.ndarray
    ray: Any
    clearness: np.ndarray


class Sight(NamedTuple):
    """What camera rays see, as numpy arrays (ray,) unless said otherwise.

    Attributes
    ----------
    hits : the surfaces whose reflected light counts; ``shape`` is 0 where it is not shared.
    alone : bool, whether that light must be traced on for the ray.
    factor : float32, how much of that light reaches the lens; None for all of it.
    segment : Dr.Jit's rays, the parts of the lines of sight that meet those surfaces.
    thrown_back : bool, whether that surface is a clear one; None where the scene has none.
    lights : ends of lines in a black lamp or the sky.
    distances : see Distances.
    """

    hits: SurfaceHits
    alone: np.ndarray
    factor: np.ndarray | None
    segment: Any
    thrown_back: np.ndarray | None
    lights: tuple[EndsInLight, ...]
    distances: Distances

    def count_straight_into_light(self) -> int:
        """Return how many rays end in light without a bend."""
        return sum(int(np.count_nonzero(self.distances.end[end.rays] > 0)) for end in self.lights)


class SurfaceFinder:
    """Finds what camera rays see in one scene.

    Places on shapes that move are those that their points would have, had the shape not moved along (turning is left
    out), so that what light paths tell at different moments stays on the shape. ``emitting`` are the ids of shapes that
    are lamps under any light group, whether lit in this scene or not.
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
        self._black: Any = mi.UInt32(black)  # lamps that reflect nothing where their reflectance is 0
        moved = np.zeros((size, 3), dtype=np.float32)
        for index, shape in shapes.items():
            moved[index] = setup.moved_m.get(shape.id(), np.zeros(3)) / setup.unit_m
        self._moved: Any = mi.Float(moved.ravel())  # read three at a time

    def find(self, rays: CameraRays, focus: np.ndarray, *, seed: int) -> Sight:
        """Follow rays, cast for these positions, to what they see; ``seed`` names the random numbers on the way."""
        setup, scene = self._setup, self._setup.mitsuba_scene
        to_camera = mi.Transform4f(setup.to_world).inverse()
        begin = opaque_number_for_rays(setup.drive.shift(float(focus[0] + focus[-1]) / 2))

        def axial(point: Any) -> Any:
            return (to_camera @ point).z * setup.unit_m - begin

        line = None
        last = segment = mi.Ray3f(rays.ray)
        if self._clear.any:
            line = follow_rays_through_glass(scene, last, self._clear, axial=axial, seed=seed, first=rays.first)
            dr.eval(*line)  # one by one: a named tuple as such is left as it is
            last = line.last
        hit = scene.ray_intersect(last)
        valid = hit.is_valid()
        distance = dr.select(valid, axial(hit.p), dr.inf)
        in_light, chance = self._at_end(hit, valid)
        factor = dr.select(in_light, mi.Float(0), 1.0)
        lights = [(in_light, last, mi.Float(1))]
        if line is not None:
            distance = dr.select(line.straight, distance, 0)
            looked_aside = line.share_aside > 0
            beside = scene.ray_intersect(line.aside, looked_aside)
            in_light_aside, chance_aside = self._at_end(beside, looked_aside & beside.is_valid())
            lights = [(in_light, last, line.clearness), (in_light_aside & looked_aside, line.aside, line.share_aside)]
            at_end, at_side = line.clearness * chance, line.share_aside * chance_aside
            total = at_end + at_side + line.thrown_back
            # A draw of 0 must not choose what is never looked at.
            is_end = line.draw * total < at_end
            is_clear = line.draw * total >= at_end + at_side
            segment = dr.select(is_end, last, dr.select(is_clear, line.segment, line.aside))
            share = dr.select(is_end, 1 / chance, dr.select(is_clear, line.per_share, 1 / chance_aside))
            factor = dr.select(total > 0, total * share, 0)
            dr.eval(segment, factor, is_clear, distance, lights)
            hit = scene.ray_intersect(segment)
            valid = hit.is_valid()
        counts = valid & (factor > 0)
        shape: Any = dr.select(counts, self._look_up(self._number, hit, valid=counts), 0)
        if line is not None:
            # Of a clear surface only what it throws back is shared, and only where no mirror adds to it.
            clear = self._clear.does_to_line(hit, counts) != OPAQUE
            shape = dr.select(clear & (~is_clear | self._clear.mirrors(hit, counts & is_clear)), 0, shape)
        # Light keeps its place on a shape that moves along, not where the shape was.
        moved = dr.gather(mi.Vector3f, self._moved, number_shapes_that_rays_hit(hit), valid)
        point = (to_camera @ mi.Point3f(hit.p - moved)) * setup.unit_m
        depth = point.z - opaque_number_for_rays(
            self._middle
        )  # from the lens at the middle of its travel, for all rays alike
        scale = opaque_number_for_rays(self._pixels_per_slope)
        column = -point.x / depth * scale + opaque_number_for_rays(setup.grid.columns / 2)
        row = -point.y / depth * scale + opaque_number_for_rays(setup.grid.rows / 2)
        beside = dr.maximum(dr.abs(column), dr.abs(row)) > PIXELS_BESIDE  # or behind: seen in a mirror
        shape = dr.select((depth <= 0) | beside, 0, shape)
        textured = (shape > 0) & (self._look_up(self._textured, hit, valid=shape > 0) > 0)
        normal = dr.normalize(mi.Vector3f(to_camera @ mi.Normal3f(hit.sh_frame.n)))
        normal = dr.select(hit.wi.z < 0, -normal, normal)  # the side that is seen
        u, v = _octahedral(normal)
        hits: list[Any] = [
            shape,
            column,
            row,
            dr.log(dr.maximum(depth, 1e-9)) * opaque_number_for_rays(self._pixels_per_slope / CELL_DEPTH),
            u,
            v,
            dr.select(textured, _reflectance(hit, textured), 1.0),
        ]
        alone = counts & (shape == 0)
        dr.eval(hits, factor, alone, distance, lights)
        found = SurfaceHits(*(array.numpy() for array in hits))
        ends = tuple(end for lit, ray, share in lights if (end := _ends_in_light(lit, ray, clearness=share)).rays.size)
        if line is None:
            return Sight(found, alone.numpy(), None, segment, None, ends, Distances(distance.numpy()))
        distances = Distances(distance.numpy(), line.nearest.numpy(), line.farthest.numpy())
        return Sight(found, alone.numpy(), factor.numpy(), segment, is_clear.numpy(), ends, distances)

    def _at_end(self, hit: Any, valid: Any) -> tuple[Any, Any]:
        """Return whether lines end in a black lamp or the sky, and else how much light the surface there may reflect.

        The latter, 0...1, decides how often this light is looked at.
        """
        lamp = self._look_up(self._black, hit, valid=valid) > 0
        shares = self._look_up(self._number, hit, valid=valid) > 0
        if self._clear.any:
            shares &= self._clear.does_to_line(hit, valid) == OPAQUE
        in_light = ~valid | (lamp & (_reflectance(hit, lamp) == 0))
        reflected = dr.clip(_reflectance(hit, shares), LEAST_CHANCE, 1)  # not computed where lines have no choice
        return in_light, dr.select(in_light, 0, dr.select(shares, reflected, 1))

    def _look_up(self, table: Any, hit: Any, *, valid: Any) -> Any:
        """Return a number of the shapes that rays hit, UInt32 (ray,)."""
        return dr.gather(mi.UInt32, table, number_shapes_that_rays_hit(hit), valid)


def _ends_in_light(in_light: Any, ray: Any, *, clearness: Any) -> EndsInLight:
    rays = np.flatnonzero(in_light.numpy()).astype(np.uint32)
    share = clearness.numpy()
    return EndsInLight(rays, ray, share[rays] if share.size > 1 else np.ones(rays.size, dtype=np.float32))


def _reflectance(hit: Any, active: Any) -> Any:
    """Return how much light surfaces reflect in all directions alike, 0 where not ``active``."""
    return dr.select(active, dr.maximum(hit.bsdf().eval_diffuse_reflectance(hit, active).x, 0), 0)


def _octahedral(normal: Any) -> tuple[Any, Any]:
    """Return a direction on the octahedral map, two coordinates in 0...1."""
    total = dr.abs(normal.x) + dr.abs(normal.y) + dr.abs(normal.z)
    x, y = normal.x / total, normal.y / total
    folded_x, folded_y = dr.copysign(1 - dr.abs(y), x), dr.copysign(1 - dr.abs(x), y)
    back = normal.z < 0
    return dr.select(back, folded_x, x) / 2 + 0.5, dr.select(back, folded_y, y) / 2 + 0.5


def _registry_index(shape: Any) -> int:
    """Return the number that a pointer to this shape holds in a kernel."""
    return int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0])


def _can_share_shading(bsdf: Any) -> bool:
    flags = int(bsdf.flags())
    glossy = flags & int(mi.BSDFFlags.Glossy)
    if flags & int(mi.BSDFFlags.Null):  # but where it reflects as a mirror does: ClearSurfaces.mirrors
        return bool(flags & int(mi.BSDFFlags.Diffuse)) and not glossy
    if "Blend" in str(bsdf) and glossy:
        return False  # Mitsuba knows no reflectance of a blend that leaves its highlights out
    return not flags & int(UNSHARED_FLAGS) and bool(flags & int(mi.BSDFFlags.Diffuse))


def _is_textured(shape: Any) -> bool:
    """Return whether a shape's reflectance changes over it; else its paths tell the radiance itself."""
    attributes = {key for key in mi.traverse(shape).keys() if key.startswith(("vertex_", "face_"))}  # noqa: SIM118
    bitmaps = any(key.endswith(TEXTURE_KEYS) for key in mi.traverse(shape.bsdf()).keys())  # noqa: SIM118
    return bitmaps or bool(attributes - GEOMETRY_ATTRIBUTES)
