"""What the camera looks at, without light: depth, the target's pixels, the truth that follows from them."""

from dataclasses import dataclass
from itertools import chain
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.errors import BadInput
from saf_gen.render.render_setup import RenderSetup, SensorGrid, make_camera_dict, make_film_dict

__all__ = ["DepthAndTarget", "trace_depth_and_target"]

ACROSS = 64  # rays across the aperture that look for something in the lens's way


@dataclass(frozen=True)
class DepthAndTarget:
    """Through a pinhole at the lens centre, at the position that focuses the target.

    depth : float32 (row, col), axial distance (m) of the first surface from the lens as the card puts it; inf
    where there is none.
    target : bool (row, col).
    """

    depth: np.ndarray
    target: np.ndarray


def trace_depth_and_target(
    setup: RenderSetup, target_shapes: tuple[str, ...], *, allow_unseen_target: bool = False
) -> DepthAndTarget:
    """Depth and target mask, one ray through each pixel's centre.

    The picture may change its scale over the travel, so the mask is taken where the target is in focus: once
    at the middle of the travel to learn its distance, or at an end where the middle does not show it, then
    there. ``allow_unseen_target``: a moment of a scene that moves, at which the target may be out of sight
    (then the mask is empty) or out of the lens's reach.

    Raises BadInput when no pixel sees the target, no position of the lens focuses it, the frame where it is
    in focus does not hold it, or the lens runs into the scene on its travel.
    """
    drive = setup.drive
    _check_the_way(setup)
    middle = _look_at(setup, target_shapes, 0.5)
    ends = (_look_at(setup, target_shapes, end) for end in (0.0, 1.0))  # looked at only where it must be
    sight = next((seen for seen in chain((middle,), ends) if seen.target.any()), None)
    if sight is None:
        if allow_unseen_target:
            return middle
        raise _out_of_sight(setup, target_shapes)
    depths = sight.depth[sight.target]
    best = drive.true_focus(depths)
    if not (allow_unseen_target or 0 <= best <= 1):
        near, far = drive.focusing_range_m
        raise BadInput(
            f"the target is {np.median(depths):.6g} m away, out of the lens's reach",
            allowed=f"{near:g} to {far:g} m ({drive.travel_key} in scene.yaml)",
            hint="move the target, or give the lens a longer travel",
        )
    there = _look_at(setup, target_shapes, min(max(best, 0.0), 1.0))
    if there.target.any() or (allow_unseen_target and sight is middle):
        return there
    if allow_unseen_target:
        return middle
    raise BadInput(
        f"the target ({', '.join(target_shapes)}) is out of the frame where it is in focus, at {best:.3f} of "
        "the travel: the picture's scale changes on the way",
        allowed="a target shape that at least one pixel sees there",
        hint=f"move it towards the middle of the picture, or shorten {drive.travel_key} in scene.yaml",
    )


def _out_of_sight(setup: RenderSetup, target_shapes: tuple[str, ...]) -> BadInput:
    named = any(shape.id() in target_shapes for shape in setup.mitsuba_scene.shapes())
    return BadInput(
        f"the target ({', '.join(target_shapes)}) is not visible to the camera",
        allowed="a target shape that at least one pixel sees",
        hint="check camera and target in scene.yaml"
        if named
        else f"no shape has that id: in scene.py let the id of a shape be its key, {target_shapes[0]!r}",
    )


def _look_at(setup: RenderSetup, target_shapes: tuple[str, ...], position: float) -> DepthAndTarget:
    sensor = {"type": "perspective", **make_camera_dict(setup, position)}
    forward = float(setup.drive.shift(position))
    axial, shape = _first_surfaces(setup, sensor, forward)
    depth = (axial + forward).astype(np.float32)
    wanted = [_index(s, i) for i, s in enumerate(setup.mitsuba_scene.shapes()) if s.id() in target_shapes]
    return DepthAndTarget(depth, np.isin(shape, wanted))


def _check_the_way(setup: RenderSetup) -> None:
    """Refuse a surface that the aperture runs into: parallel rays across it, from the far end of its way."""
    drive, radius = setup.drive, setup.drive.aperture_radius_m
    start, end = sorted(float(z) for z in drive.shift(np.array([0.0, 1.0])))
    if start == end:
        return
    # 1e-4 of the radius: its own default, 0.01, would hide a specimen.
    sensor = {
        "type": "orthographic",
        "to_world": setup.to_world_at(start)
        @ mi.ScalarTransform4f().scale([radius / setup.unit_m] * 2 + [1]),
        "near_clip": 1e-4 * radius / setup.unit_m,
        "film": make_film_dict(SensorGrid(ACROSS, ACROSS, 1.0)),
    }
    nearest = float(_first_surfaces(setup, sensor, start)[0].min()) + start
    if nearest <= end:
        raise BadInput(
            f"the stage runs the scene into the lens: a surface lies {nearest:.6g} m before it",
            allowed=f"nothing nearer than the travel's end, {end:g} m (travel_m in scene.yaml)",
            hint="shorten the travel, or move the scene",
        )


def _first_surfaces(
    setup: RenderSetup, sensor: dict[str, Any], forward_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """What a sensor sees through each pixel's centre: axial distance (m) of the first surface, its index.

    float64 and int64 (row, col); the distance counts from the lens moved ``forward_m``, inf for nothing.
    """
    # One sample, not jittered: the ray through the pixel's centre.
    sampler = {"type": "stratified", "sample_count": 1, "jitter": False}
    loaded = mi.load_dict({**sensor, "sampler": sampler})
    integrator = mi.load_dict({"type": "aov", "aovs": "point:position,shape:shape_index"})
    # Not mi.render: for gradients, which nobody asks for here, it keeps the scene in a cycle of references.
    planes = np.array(integrator.render(setup.mitsuba_scene, sensor=loaded, spp=1), dtype=np.float64)
    point, shape = planes[..., 0:3], planes[..., 3].astype(np.int64)
    to_camera = np.linalg.inv(np.array(setup.to_world_at(forward_m).matrix, dtype=np.float64))
    axial = (point @ to_camera[2, :3] + to_camera[2, 3]) * setup.unit_m
    return np.where(shape > 0, axial, np.inf), shape  # index 0: the ray met nothing


def _index(shape: Any, place: int) -> int:
    """What the shape_index channel holds for a shape.

    A JIT variant counts through every shape alive in the process, in the order in which threads happened to
    make them; the place in the scene is right in scalar alone.
    """
    if not dr.is_jit_v(mi.Float):
        return place + 1
    return int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0])
