"""What the camera looks at, without light: depth, the target's pixels, the truth that follows from them."""

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.errors import BadInput
from saf_gen.render.film import Setup, field_of_view, film_dict

__all__ = ["Geometry", "look"]


@dataclass(frozen=True)
class Geometry:
    """Through a pinhole at the lens centre, at the image distance that focuses the target.

    depth : float32 (row, col), axial distance (m) of the first surface; inf where there is none.
    target : bool (row, col).
    """

    depth: np.ndarray
    target: np.ndarray


def look(setup: Setup, target_shapes: tuple[str, ...]) -> Geometry:
    """Depth and target mask, one ray through each pixel's centre.

    The picture breathes as the lens moves, so the mask is taken where the target is in focus: once at the
    middle of the travel to learn its distance, then there.

    Raises BadInput when no pixel sees the target, or no position of the lens focuses it.
    """
    drive = setup.drive
    geometry = _look_at(setup, target_shapes, 0.5)
    best = drive.truth(geometry.depth[geometry.target])
    if not 0 <= best <= 1:
        near, far = sorted(drive.focus_range_m)
        raise BadInput(
            f"the target is {np.median(geometry.depth[geometry.target]):.4g} m away, out of the lens's reach",
            allowed=f"{near:g} to {far:g} m (focus_range_m in scene.yaml)",
            hint="move the target, or give the lens a longer travel",
        )
    return _look_at(setup, target_shapes, best)


def _look_at(setup: Setup, target_shapes: tuple[str, ...], position: float) -> Geometry:
    drive, film, to_world = setup.drive, setup.film, setup.to_world
    sensor = mi.load_dict(
        {
            "type": "perspective",
            "to_world": to_world,
            "near_clip": 1e-4,
            **field_of_view(film, float(drive.image_distance(position))),
            "film": film_dict(film),
            # One sample, not jittered: the ray through the pixel's centre.
            "sampler": {"type": "stratified", "sample_count": 1, "jitter": False},
        }
    )
    integrator = mi.load_dict({"type": "aov", "aovs": "point:position,shape:shape_index"})
    planes = np.array(mi.render(setup.world, sensor=sensor, integrator=integrator, spp=1), dtype=np.float64)
    point, shape = planes[..., 0:3], planes[..., 3]
    to_camera = np.linalg.inv(np.array(to_world.matrix, dtype=np.float64))
    axial = point @ to_camera[2, :3] + to_camera[2, 3]
    depth = np.where(shape > 0, axial, np.inf).astype(np.float32)  # index 0: the ray met nothing
    wanted = [_index(s, i) for i, s in enumerate(setup.world.shapes()) if s.id() in target_shapes]
    target = np.isin(shape.astype(np.int64), wanted)
    if not target.any():
        raise BadInput(
            f"the target ({', '.join(target_shapes)}) is not visible to the camera",
            allowed="a target shape that at least one pixel sees",
            hint="check camera and target in scene.yaml",
        )
    return Geometry(depth, target)


def _index(shape: Any, place: int) -> int:
    """What the shape_index channel holds for a shape.

    A JIT variant counts through every shape alive in the process, in the order in which threads happened to
    make them; the place in the scene is right in scalar alone.
    """
    if not dr.is_jit_v(mi.Float):
        return place + 1
    return int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0])
