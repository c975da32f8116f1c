"""Where camera rays first meet the scene, and which of these surfaces may share their shading.

A surface shares shading if the light that it sends to the lens is the product of what falls on it, which changes
slowly, and of a reflectance, which is its texture. So a lamp does not, nor what a delta function reflects or lets
through (glass, a mirror, a mask), nor a polished metal: paths that meet these first are taken as they were traced.
"""

from collections.abc import Collection
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.render.camera_rays import CameraRays, opaque_number
from saf_gen.render.render_setup import RenderSetup
from saf_gen.render.shading_cells import SurfaceHits

CELL_DEPTH = 16.0  # depth of a smallest cell over the width of a pixel at its distance
GEOMETRY_ATTRIBUTES = {"vertex_positions", "vertex_normals", "vertex_texcoords"}
TEXTURE_KEYS = (".data", ".color0", ".color0.value")  # of a bitmap, and of a checkerboard
UNSHARED_FLAGS = mi.BSDFFlags.Delta | mi.BSDFFlags.Delta1D | mi.BSDFFlags.Null


class SurfaceFinder:
    """Finds the first surfaces of camera rays in one scene.

    Places on shapes that move are those that their points would have, had the shape not moved along (turning is left
    out), so that what light paths tell at different moments stays on the shape. ``emitting`` are the ids of shapes that
    are lamps under any light group, whether lit in this scene or not.
    """

    def __init__(self, setup: RenderSetup, *, emitting: Collection[str]) -> None:
        self._setup = setup
        drive, grid = setup.drive, setup.grid
        self._middle = float(drive.shift(0.5))
        self._pixels_per_slope = float(drive.image_distance(0.5)) / grid.pitch_m
        shapes = setup.mitsuba_scene.shapes()
        indices = [_registry_index(shape) for shape in shapes]
        number, textured = (np.zeros(max(indices, default=0) + 1, dtype=np.uint32) for _ in range(2))
        for n, (index, shape) in enumerate(zip(indices, shapes, strict=True), start=1):
            if shape.id() not in emitting and not shape.is_emitter() and _can_share_shading(shape.bsdf()):
                number[index], textured[index] = n, _is_textured(shape)
        self._number: Any = mi.UInt32(number)
        self._textured: Any = mi.UInt32(textured)
        moved = np.zeros((max(indices, default=0) + 1, 3), dtype=np.float32)
        for index, shape in zip(indices, shapes, strict=True):
            moved[index] = setup.moved_m.get(shape.id(), np.zeros(3)) / setup.unit_m
        self._moved: Any = mi.Float(moved.ravel())  # read three at a time

    def find(self, rays: CameraRays, focus: np.ndarray) -> SurfaceHits:
        """Trace rays, cast for these positions, to their first surface; its shape is 0 where it shares no shading."""
        setup = self._setup
        hit = setup.mitsuba_scene.ray_intersect(rays.ray)
        index: Any = dr.reinterpret_array(mi.UInt32, hit.shape)
        valid = hit.is_valid()
        shape: Any = dr.gather(mi.UInt32, self._number, index, valid)
        shares = valid & (shape > 0)
        textured = shares & (dr.gather(mi.UInt32, self._textured, index, valid) > 0)
        to_camera = mi.Transform4f(setup.to_world).inverse()
        lens = opaque_number(setup.drive.shift(float(focus[0] + focus[-1]) / 2))
        distance = (to_camera @ hit.p).z * setup.unit_m - lens
        # Light keeps its place on a shape that moves along, not where the shape was.
        place = mi.Point3f(hit.p - dr.gather(mi.Vector3f, self._moved, index, valid))
        point = (to_camera @ place) * setup.unit_m
        depth = point.z - opaque_number(self._middle)  # from the lens at the middle of its travel, for all rays alike
        normal = dr.normalize(mi.Vector3f(to_camera @ mi.Normal3f(hit.sh_frame.n)))
        normal = dr.select(hit.wi.z < 0, -normal, normal)  # the side that is seen
        u, v = _octahedral(normal)
        found: Any = hit.bsdf(rays.ray).eval_diffuse_reflectance(hit, textured)
        reflectance: Any = found.x if dr.size_v(found) == 1 else mi.luminance(found)
        scale = opaque_number(self._pixels_per_slope)
        fields: list[Any] = [
            dr.select(shares, shape, 0),
            -point.x / depth * scale + setup.grid.columns / 2,
            -point.y / depth * scale + setup.grid.rows / 2,
            dr.log(dr.maximum(dr.abs(depth), 1e-9)) * opaque_number(self._pixels_per_slope / CELL_DEPTH),
            u,
            v,
            dr.select(textured, dr.maximum(reflectance, 0), 1.0),
            dr.select(shares, distance, dr.select(valid, mi.Float(0), dr.inf)),
        ]
        dr.eval(*fields)
        return SurfaceHits(*(array.numpy() for array in fields))


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
    if "Blend" in str(bsdf) and flags & int(mi.BSDFFlags.Glossy):
        return False  # Mitsuba knows no reflectance of a blend that leaves its highlights out
    return not flags & int(UNSHARED_FLAGS) and bool(flags & int(mi.BSDFFlags.Diffuse))


def _is_textured(shape: Any) -> bool:
    """Return whether a shape's reflectance changes over it; else its paths tell the radiance itself."""
    attributes = {key for key in mi.traverse(shape).keys() if key.startswith(("vertex_", "face_"))}  # noqa: SIM118
    bitmaps = any(key.endswith(TEXTURE_KEYS) for key in mi.traverse(shape.bsdf()).keys())  # noqa: SIM118
    return bitmaps or bool(attributes - GEOMETRY_ATTRIBUTES)
