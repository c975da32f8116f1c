"""Traces, without light, the depth map and the target's pixels, from which the true focus follows, and texels.

Lines of sight pass through clear surfaces to the target: see :mod:`saf_gen.render.pinhole_sight`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.errors import BadInput
from saf_gen.optics import FittedRays
from saf_gen.render.pinhole_sight import PinholeSight, apparent_distance, lines_of_sight
from saf_gen.render.render_setup import RenderSetup, SensorGrid, camera_dict, film_dict, render_with_camera

RAY_OFFSET_PX = 1 / 256  # distance of a second and a third ray from the pixel's centre, on either side
RAY_OFFSET_DIRECTION = 0.554  # rad; no mesh has edges in this direction by design
APERTURE_RAYS = 64  # per side of a grid over the aperture, to find surfaces that the lens would run into


@dataclass(frozen=True)
class DepthAndTarget:
    """Depth and target seen by a pinhole at the lens centre, at the focus position that focuses the target.

    Attributes
    ----------
    depth : ndarray of float32, shape (row, col)
        Axial distance (m) of the first visible surface from the lens as the card places it; inf if there is no surface.
        If a pixel sees the target through glass, the distance of the plane in which it appears.
    target : ndarray of bool, shape (row, col)
        Pixels that see the target.
    residual_blur_px : float
        Median diameter (pixels), over the pixels that see the target through glass, of the blur that the glass leaves
        at the best position; 0 if there are none.
    """

    depth: np.ndarray
    target: np.ndarray
    residual_blur_px: float = 0.0


def trace_geometry(
    setup: RenderSetup, target_shapes: tuple[str, ...], *, allow_unseen_target: bool = False
) -> DepthAndTarget:
    """Trace depth and the target mask through the centre of each pixel.

    The scale of the image may change over the travel, so the mask is traced at the position that focuses the target. To
    find this position, the target's distance is first traced at the middle of the travel, or at an end if the target is
    not seen from the middle.

    Parameters
    ----------
    setup : RenderSetup
        Scene in front of its lens.
    target_shapes : tuple of str
        Ids of the target's shapes.
    allow_unseen_target : bool, default False
        Accept a target that is out of sight (the mask is then empty) or that no position of the lens focuses, as may
        happen in a moving scene.

    Raises
    ------
    BadInput
        If no pixel sees the target, no position of the lens focuses it, it is out of the frame at the position that
        focuses it, or the lens runs into the scene on its travel.
    """
    drive = setup.drive
    _check_lens_travel(setup)
    # Lazy, because the ends are rarely needed. These traces only find where to look.
    traces = ((end, trace_depth_at(setup, target_shapes, position=end, rays=1)) for end in (0.5, 0.0, 1.0))
    seen_from, sight = next(((end, seen) for end, seen in traces if seen.target.any()), (0.5, None))
    if sight is None:
        if allow_unseen_target:
            return trace_depth_at(setup, target_shapes, position=0.5)
        raise _out_of_sight_error(setup, target_shapes)
    depths = sight.depth[sight.target]
    best = setup.in_focus.true_focus(sight.depth, sight.target)
    if not (allow_unseen_target or 0 <= best <= 1):
        near, far = drive.focusing_range_m
        raise BadInput(
            f"the target is {np.median(depths):.6g} m away, out of the lens's reach",
            allowed=f"{near:g} to {far:g} m ({drive.travel_key} in scene.yaml)",
            hint="move the target, or give the lens a longer travel",
        )
    focused = trace_depth_at(setup, target_shapes, position=min(max(best, 0.0), 1.0))
    if focused.target.any() or (allow_unseen_target and seen_from == 0.5):
        return focused
    if allow_unseen_target:
        return trace_depth_at(setup, target_shapes, position=0.5)
    raise BadInput(
        f"the target ({', '.join(target_shapes)}) is outside the image at {best:.3f} of the travel, where it is in "
        "focus; the scale of the image changes over the travel",
        allowed="a target shape that at least one pixel sees there",
        hint=f"move it towards the middle of the image, or shorten {drive.travel_key} in scene.yaml",
    )


def _out_of_sight_error(setup: RenderSetup, target_shapes: tuple[str, ...]) -> BadInput:
    shapes = setup.mitsuba_scene.shapes()
    named = any(shape.id() in target_shapes or shape.class_name() == "Instance" for shape in shapes)
    return BadInput(
        f"the target ({', '.join(target_shapes)}) is not visible to the camera",
        allowed="a target shape that at least one pixel sees, also through clear glass",
        hint="check camera and target in scene.yaml"
        if named
        else f"no shape has that id: in scene.py, set the id of the shape to its key, {target_shapes[0]!r}",
    )


def trace_depth_at(
    setup: RenderSetup, target_shapes: tuple[str, ...], *, position: float, rays: int = 3
) -> DepthAndTarget:
    """Return depth and target through the centre of each pixel at one focus position.

    The edge that two triangles share is not watertight: a ray that meets it exactly may slip through, as happens if the
    edge runs through the centres of pixels, for example in a box turned by 45°. Each pixel is therefore traced with
    three rays on a short line, and the surface at the median of their depths counts. On a single surface this is the
    surface at the middle ray, whatever its slope; at an outline it is the surface that the middle ray and one of the
    others see. If ``rays`` is 1, only the middle ray is traced.
    """
    sight = PinholeSight(setup.mitsuba_scene, target_shapes)
    offsets = (0.0, -RAY_OFFSET_PX, RAY_OFFSET_PX)[:rays]
    cameras = [_make_offset_camera(setup, position, offset_px=offset_px) for offset_px in offsets]
    axials, targets, residual_blur_px = _first_surfaces(setup, cameras, sight=sight, position=position)
    middle = np.argsort(axials, axis=0, kind="stable")[rays // 2 : rays // 2 + 1]
    middle[np.take_along_axis(axials, middle, axis=0) == axials[:1]] = 0
    axial, target = (np.take_along_axis(planes, middle, axis=0)[0] for planes in (axials, targets))
    depth = (axial + float(setup.drive.shift(position))).astype(np.float32)
    return DepthAndTarget(depth, target, residual_blur_px)


def _make_offset_camera(setup: RenderSetup, position: float, *, offset_px: float) -> dict[str, Any]:
    """Return a pinhole camera whose rays miss the centres of the pixels by ``offset_px`` pixels."""
    across, down = offset_px * np.cos(RAY_OFFSET_DIRECTION), offset_px * np.sin(RAY_OFFSET_DIRECTION)
    return {
        "type": "perspective",
        **camera_dict(setup, position),
        "principal_point_offset_x": float(across) / setup.grid.columns,
        "principal_point_offset_y": float(down) / setup.grid.rows,
    }


def _check_lens_travel(setup: RenderSetup) -> None:
    """Trace rays along the travel, and raise BadInput if the aperture would run into a surface."""
    drive, radius = setup.drive, setup.drive.aperture_radius_m
    start, end = sorted(float(z) for z in drive.shift(np.array(setup.travel)))
    if start == end:
        return
    # Mitsuba's default near clip, 0.01 units, would hide a specimen.
    sensor = {
        "type": "orthographic",
        "to_world": setup.to_world_at(start) @ mi.ScalarTransform4f().scale([radius / setup.unit_m] * 2 + [1]),
        "near_clip": 1e-4 * radius / setup.unit_m,
        "film": film_dict(SensorGrid(APERTURE_RAYS, APERTURE_RAYS, 1.0)),
    }
    at = setup.travel[0] if float(drive.shift(setup.travel[0])) == start else setup.travel[1]
    sight = PinholeSight(setup.mitsuba_scene, ())
    nearest = float(_first_surfaces(setup, [sensor], sight=sight, position=at).axial.min()) + start
    if nearest <= end:
        raise BadInput(
            f"the stage runs the scene into the lens: a surface is {nearest:.6g} m in front of it",
            allowed=f"nothing nearer than the travel's end, {end:g} m (travel_m in scene.yaml)",
            hint="shorten the travel, or move the scene",
        )


class _Traced(NamedTuple):
    """One ray per pixel of some cameras: axial distance (m) of what it shows from the lens, inf if nothing, and whether
    it shows the target, both (camera, row, col); median blur (pixels) that glass leaves in the first camera.
    """

    axial: np.ndarray
    target: np.ndarray
    residual_blur_px: float = 0.0


def _first_surfaces(
    setup: RenderSetup, sensors: Sequence[dict[str, Any]], *, sight: PinholeSight, position: float
) -> _Traced:
    """Trace the ray through each pixel's centre to what it shows, for cameras of the same size.

    Rays behind glass are followed together, because that costs the same for few as for many.
    """
    # One sample that is not jittered is the ray through the pixel's centre.
    sampler = {"type": "stratified", "sample_count": 1, "jitter": False}
    cameras = [mi.load_dict({**sensor, "sampler": sampler}) for sensor in sensors]
    points, shapes = zip(*(_meet_surfaces(setup, camera, position=position) for camera in cameras), strict=True)
    point, shape = np.stack(points), np.stack(shapes)
    to_camera = np.linalg.inv(np.array(setup.to_world_at(float(setup.drive.shift(position))).matrix, dtype=np.float64))

    def axial_of(points: np.ndarray) -> np.ndarray:
        return (points @ to_camera[2, :3] + to_camera[2, 3]) * setup.unit_m

    axial = np.where(shape > 0, axial_of(point), np.inf)  # index 0: the ray met nothing
    numbered = [(_shape_index(s, i), s) for i, s in enumerate(setup.mitsuba_scene.shapes())]
    target = np.isin(shape, [index for index, s in numbered if sight.is_target(s)])
    followed = [index for index, s in numbered if sight.must_follow(s)]
    number, rows, columns = np.nonzero(shape > 0 if sight.has_instances else np.isin(shape, followed))
    if not rows.size:
        return _Traced(axial, target)
    x, y = (columns + 0.5) / shape.shape[2], (rows + 0.5) / shape.shape[1]
    lines = [
        lines_of_sight(setup, camera, x=x[number == n], y=y[number == n], position=position)
        for n, camera in enumerate(cameras)
        if (number == n).any()
    ]
    origin, direction = (np.concatenate(parts) for parts in zip(*lines, strict=True))
    ends = sight.follow(origin, direction)

    def distances(points: np.ndarray, passed: np.ndarray) -> np.ndarray:
        """Return axial distances; those of surfaces that the camera has met are its own, to the last bit."""
        found = np.where(ends.seen, axial_of(np.where(ends.seen[:, None], points, 0)), np.inf)
        return np.where(ends.seen & (passed == 0), axial[number, rows, columns], found)

    distance, on_target, residual = distances(ends.point, ends.passed), ends.on_target.copy(), 0.0
    behind = np.flatnonzero(on_target & ends.bent)
    if behind.size:
        local = direction[behind] @ to_camera[:3, :3].T
        slope = local[:, :2] / local[:, 2:]
        found, blur = apparent_distance(setup, sight, ends=ends.only(behind), slope=slope, position=position)
        sharp = np.isfinite(found)
        distance[behind] = np.where(sharp, found, distances(ends.first, ends.first_passed)[behind])
        on_target[behind] = sharp
        of_first = sharp & (number[behind] == 0)
        residual = float(np.median(blur[of_first])) if of_first.any() else 0.0
    axial[number, rows, columns], target[number, rows, columns] = distance, on_target
    return _Traced(axial, target, residual)


def _meet_surfaces(setup: RenderSetup, camera: Any, *, position: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the point that each pixel sees, float64 (row, col, 3), and its shape_index, int (row, col), 0 for none."""
    if setup.drive.distortion is None and not isinstance(setup.drive.wavefront, FittedRays):
        integrator = mi.load_dict({"type": "aov", "aovs": "point:position,shape:shape_index"})
        planes = render_with_camera(setup.mitsuba_scene, camera, integrator=integrator, samples=1).astype(np.float64)
        return planes[..., 0:3], planes[..., 3].astype(np.int64)
    # No camera of Mitsuba has these rays.
    size = setup.grid.rows, setup.grid.columns
    rows, columns = (part.ravel() for part in np.indices(size))
    at = {"x": (columns + 0.5) / size[1], "y": (rows + 0.5) / size[0]}
    origin, direction = lines_of_sight(setup, camera, **at, position=position)
    begin, ahead = (mi.Vector3f(*(mi.Float(v.astype(np.float32)) for v in part.T)) for part in (origin, direction))
    hit = setup.mitsuba_scene.ray_intersect(mi.Ray3f(mi.Point3f(begin), ahead))
    point = np.array(hit.p, dtype=np.float64).reshape(3, -1).T
    shape = np.where(np.array(hit.is_valid()), np.array(dr.reinterpret_array(mi.UInt32, hit.shape)), 0)
    return point.reshape(*size, 3), shape.astype(np.int64).reshape(size)


def _shape_index(shape: Any, number: int) -> int:
    """Return the value of the shape_index channel for the shape with this number in the scene.

    A JIT backend counts all shapes alive in the process, in the order in which threads happened to make them; only
    scalar counts the shapes of the scene.
    """
    if not dr.is_jit_v(mi.Float):
        return number + 1
    return int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0])


def footprints(
    setup: RenderSetup, target_shapes: tuple[str, ...], *, position: float, target: np.ndarray
) -> np.ndarray:
    """Return the size (m) of a texel at each target pixel, from the finest bitmap of its shape, float64 (pixel,).

    A texel of a bitmap with (rows, columns) texels spans |∂p/∂u| / columns along one side and |∂p/∂v| / rows along the
    other, after the texture's own scaling; the size is their geometric mean. Pixels of shapes without a bitmap or
    without texture coordinates are left out, because geometry and formulas are sharp at any size.

    Parameters
    ----------
    setup : RenderSetup
        Scene in front of its lens.
    target_shapes : tuple of str
        Ids of the target's shapes.
    position : float
        Focus position, as a fraction of the travel.
    target : ndarray of bool, shape (row, col)
        The target's pixels at this position.
    """
    sampler = {"type": "stratified", "sample_count": 1, "jitter": False}
    camera = mi.load_dict({"type": "perspective", **camera_dict(setup, position), "sampler": sampler})
    sizes = []
    for shape in (s for s in setup.mitsuba_scene.shapes() if s.id() in target_shapes and s.class_name() != "Instance"):
        density = _texel_density(shape.bsdf())
        if density > 0:
            shape_scene = mi.load_dict({"type": "scene", "it": shape}, optimize=False)
            integrator = mi.load_dict({"type": "aov", "aovs": "u:dp_du,v:dp_dv"})
            planes = render_with_camera(shape_scene, camera, integrator=integrator, samples=1).astype(np.float64)
            area = np.linalg.norm(np.cross(planes[..., 0:3], planes[..., 3:6]), axis=-1)[target]
            sizes.append(np.sqrt(area[area > 0] / density) * setup.unit_m)
    return np.concatenate(sizes) if sizes else np.empty(0)


def _texel_density(bsdf: Any) -> float:
    """Return the texels per unit square of texture coordinates of the finest bitmap; 0 without a bitmap."""
    densest = 0.0
    parameters = mi.traverse(bsdf)
    for key, value in parameters.items():
        if key.endswith(".data") and len(np.shape(value)) == 3:
            rows, columns = np.shape(value)[:2]
            scaling = parameters.get(key.removesuffix("data") + "to_uv")
            matrix = np.eye(3) if scaling is None else np.array(scaling.matrix, dtype=np.float64)
            matrix = matrix.reshape(matrix.shape[0], matrix.shape[1])
            densest = max(densest, rows * columns * abs(np.linalg.det(matrix[:2, :2])))
    return densest
