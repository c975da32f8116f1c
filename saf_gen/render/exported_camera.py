"""The camera of an exported scene as a card describes it: its pose, lens and target."""

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.errors import BadInput, closest, some_of, unknown
from saf_gen.plugins.lights import RESERVED_GROUP_NAMES
from saf_gen.render import backend, mitsuba_scene
from saf_gen.render.mitsuba_words import parse_refusal
from saf_gen.render.pinhole_sight import PinholeSight
from saf_gen.render.render_setup import SensorGrid, film_dict, render_with_camera
from saf_gen.render.scene_values import check_values, worst_hue
from saf_gen.scene.xml import Element, SceneXml, read_scene_xml

REFERENCE_GRID = SensorGrid(rows=250, columns=400, pitch_m=20e-6)
SENSOR_WIDTH_M = REFERENCE_GRID.columns * REFERENCE_GRID.pitch_m
MIN_F_NUMBER, DEFAULT_F_NUMBER = 1.0, 2.0  # default for a pinhole
PERSPECTIVE = ("perspective", "thinlens")


@dataclass(frozen=True)
class ExportedCamera:
    """Pose, lens, light groups and target of an exported camera with a sensor 8 mm wide.

    Attributes
    ----------
    name : str
        Name of the camera in the comment on the card.
    origin_m : tuple of float
        Position, in metres.
    look_at_m : tuple of float
        Point where the optical axis meets the target, in metres.
    up : tuple of float
        Unit vector that points upwards in the image.
    focal_length_mm : float
        Focal length, in millimetres.
    f_number : float
        F-number, 1 to 64.
    lights : dict of str to str
        Emitter of each light group.
    target : tuple of str
        Ids of the shapes that should be in focus.
    distance_m : float
        Distance to the target, in metres.
    unit_m : float
        Metres per unit of the file.
    notes : tuple of str
        Lines about what was taken otherwise than in the file, or left out.
    """

    name: str
    origin_m: tuple[float, ...]
    look_at_m: tuple[float, ...]
    up: tuple[float, ...]
    focal_length_mm: float
    f_number: float
    lights: dict[str, str]
    target: tuple[str, ...]
    distance_m: float
    unit_m: float = 1.0
    notes: tuple[str, ...] = ()


def exported_camera(
    read: SceneXml, path: Path, *, camera: str = "", target: str = "", nodes: Mapping[str, str] = MappingProxyType({})
) -> ExportedCamera:
    """Return a perspective camera of a scene, aimed at the first opaque surface behind all clear ones.

    Units are metres, unless the lens could not blur the target: then they are the largest power of ten at which it can.

    Parameters
    ----------
    read : SceneXml
        Scene that was read from the file.
    path : Path
        File of the scene, for messages.
    camera : str, optional
        Id of the camera, in place of the first.
    target : str, optional
        Id of a shape, or node, that should be in focus instead.
    nodes : mapping of str to str, optional
        Node of each shape, by its id; the shapes of a node are one target.

    Returns
    -------
    ExportedCamera
        The camera; its f-number follows from the file's aperture, and is 2 for a pinhole.

    Raises
    ------
    BadInput
        If the scene has no perspective camera, or none of this name, no lamp, no such target, or nothing in the middle
        of the image, if the camera is invalid, or if no scale lets its lens blur the target.
    """
    backend.activate_backend("scalar")
    described = mitsuba_scene.parse_scene_dict(read.text, path)
    check_values(described, where=str(path))
    hues = worst_hue(described)
    lamps = mitsuba_scene.emitter_names(described)
    if not lamps:
        raise BadInput("the scene has no lamp", where=str(path), hint="export its lamps, or add a lamp")
    props, film, others = _chosen_camera(read, path, name=camera)
    pose = _pose(props, path)
    origin, ahead, up = pose
    size = _film_size(film)
    half = math.tan(math.radians(_field_of_view(props, size, path=path)) / 2)
    loaded, _ = mitsuba_scene.load_lit_scene(described, tuple(lamps), max_depth=2, where=str(path))
    if target:
        names = _named(target, mitsuba_scene.shape_names(described), nodes=nodes, path=path)
        units = _distance(loaded, names, pose=pose, half=half)
        if units is None:
            problem = f"{_name(props) if others else 'the camera'} does not see {names[0]!r}"
            raise BadInput(problem, where=str(path), hint=f"aim it, or choose another target{_or(others)}")
    else:
        middle = _in_the_middle(loaded, origin=origin, ahead=ahead)
        if middle is None:
            frame = f"image of {_name(props)}" if others else "camera's image"
            hint = f"aim the camera at the target and export again, or name the target with --target{_or(others)}"
            raise BadInput(f"nothing is in the middle of the {frame}", where=str(path), hint=hint)
        seen, units = middle
        names = tuple(name for name, node in nodes.items() if node == nodes.get(seen)) or (seen,)
    image = SENSOR_WIDTH_M / 2 / half
    unit_m, f_number, scale_notes = _scale(props, units, image_m=image, path=path)
    distance = units * unit_m
    return ExportedCamera(
        name=f"{props.plugin_name()} {props.id()}".rstrip(),
        origin_m=tuple((origin * unit_m).tolist()),
        look_at_m=tuple(((origin + units * ahead) * unit_m).tolist()),
        up=tuple(up.tolist()),
        focal_length_mm=1e3 / (1 / image + 1 / distance),
        f_number=f_number,
        lights=_light_groups(lamps),
        target=names,
        distance_m=distance,
        unit_m=unit_m,
        notes=(
            *scale_notes,
            *_other_cameras(props, others),
            *_left_out(props, read, film=film, units=units),
            *_turned_away(loaded, pose=pose, half=half),
            *((hues,) if hues else ()),
        ),
    )


def _in_the_middle(scene: Any, *, origin: np.ndarray, ahead: np.ndarray) -> tuple[str, float] | None:
    """Return the shape in the middle of the picture, and its distance (scene units), or None."""
    sight = PinholeSight(scene, ())
    ends = sight.follow(origin[None], ahead[None])
    if not ends.seen[0]:
        return None
    # The line may go on through clear surfaces, and end behind them or nowhere.
    number, instance, point = ends.at_last(0)
    return sight.name_of(instance) or sight.name_of(number), float(ahead @ (point - origin))


def _named(target: str, shapes: list[str], *, nodes: Mapping[str, str], path: Path) -> tuple[str, ...]:
    """Return the shapes with this id, or of the node with this name."""
    names = tuple(name for name in shapes if target in (name, nodes.get(name)))
    if not names:
        raise unknown("target", target, allowed={**dict.fromkeys(nodes.values() or shapes)}, where=str(path))
    return names


def _rays(pose: tuple[np.ndarray, ...], *, half: float) -> np.ndarray:
    """Return the directions of the pixels of a picture of 40 × 25 pixels, float64 (pixel, 3)."""
    _, ahead, up = pose
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(-1, 1, 40), np.linspace(-1, 1, 25) * 25 / 40))
    rays = ahead + half * (x[:, None] * np.cross(ahead, up) + y[:, None] * up)
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _turned_away(scene: Any, *, pose: tuple[np.ndarray, ...], half: float) -> Iterator[str]:
    """Yield a line for the shapes that are black because most of what is seen of them is their back side."""
    seen, backs = Counter[str](), Counter[str]()
    origin: Any = mi.ScalarPoint3f(pose[0])
    for direction in _rays(pose, half=half):
        ray: Any = mi.ScalarVector3f(direction)
        hit = scene.ray_intersect(mi.Ray3f(origin, ray))
        if hit.is_valid() and not hit.shape.is_emitter():
            name = hit.shape.id()
            seen[name] += 1
            backs[name] += not mi.has_flag(hit.bsdf().flags(), mi.BSDFFlags.BackSide) and hit.wi.z <= 0
    if names := [name for name, count in seen.items() if 2 * backs[name] > count]:
        yield f"surfaces that turn their back to the lens are black: {', '.join(names)} (make them twosided)"


def _distance(scene: Any, names: tuple[str, ...], *, pose: tuple[np.ndarray, ...], half: float) -> float | None:
    """Return the median distance (scene units) of a target in a picture of 40 × 25 pixels, None if it is not seen."""
    origin, ahead, _ = pose
    rays = _rays(pose, half=half)
    ends = PinholeSight(scene, names).follow(np.tile(origin, (len(rays), 1)), rays)
    if not ends.on_target.any():
        return None
    return float(np.median((ends.point[ends.on_target] - origin) @ ahead))


def source_pictures(path: Path, grid: SensorGrid, *, samples: int, count: int = 2, camera: str = "") -> np.ndarray:
    """Return the luminance of what a perspective camera of a scene sees as a pinhole, float32 (n, row, col).

    Mitsuba renders it in RGB, with light along paths of up to six segments, and with the width of the file's picture,
    ``count`` times with other noise. ``camera`` is the id of the camera, in place of the first.

    Raises BadInput if the scene cannot be read or has no such camera.
    """
    backend.activate_backend("scalar")
    read = read_scene_xml(path, {})
    described = mitsuba_scene.parse_scene_dict(read.text, path)
    lamps = tuple(mitsuba_scene.emitter_names(described))
    loaded, integrator = mitsuba_scene.load_lit_scene(described, lamps, max_depth=6, where=str(path))
    props, film, _ = _chosen_camera(read, path, name=camera)
    pose = np.array(props.get("to_world", mi.ScalarTransform4f()).matrix, dtype=np.float64)
    pose[:, :3] /= np.linalg.norm(pose[:, :3], axis=0)  # a camera may be scaled, and Mitsuba refuses that
    kept = ("near_clip", "far_clip", "principal_point_offset_x", "principal_point_offset_y")
    pinhole = mi.load_dict(
        {
            "type": "perspective",
            **{key: props[key] for key in kept if key in props},
            "to_world": mi.ScalarTransform4f(pose.tolist()),
            "fov_axis": "x",
            "fov": _field_of_view(props, _film_size(film), path=path),
            "film": film_dict(grid),
            "sampler": {"type": "independent", "sample_count": samples},
        }
    )
    images = [render_with_camera(loaded, pinhole, integrator=integrator, samples=samples, seed=n) for n in range(count)]
    return np.reshape(images, (count, grid.rows, grid.columns))


MIN_BLUR_PX = 4.0  # at an end of the travel that the card gets; with less, no method finds the focus
TRAVEL = (1.5, 0.75)  # object distances in focus at positions 0 and 1, over the target's distance
SMALLEST = 9  # the scale of a scene is no smaller than this power of a tenth


def blur_px(distance_m: float, *, image_m: float, f_number: float) -> float:
    """Return the blur of a target at an end of the travel, in pixels of the reference sensor.

    ``image_m`` is the distance of the sensor from the lens (m) that focuses on the target.
    """
    focal = 1 / (1 / image_m + 1 / distance_m)
    blurs = []
    for u in (ratio * distance_m for ratio in TRAVEL):
        v = 1 / (1 / focal - 1 / u) if u > focal else math.inf
        blurs.append(focal / f_number * v * abs(1 / distance_m - 1 / u))
    return max(blurs) / REFERENCE_GRID.pitch_m


def fitting_scale(distance: float, *, image_m: float, radius: float = 0.0) -> tuple[float, float] | None:
    """Return the largest power of ten, 1 or less, of metres per unit at which a lens blurs a target, and its f-number.

    A scaled target is farther away than the sensor is from the lens. The result is None if no power does.

    Parameters
    ----------
    distance : float
        Distance of the target, in units.
    image_m : float
        Distance of the sensor from the lens, in metres.
    radius : float, default 0.0
        Radius of the aperture in units; 0 stands for f/2.
    """
    for power in range(SMALLEST + 1):
        unit_m = float(f"1e-{power}")
        distance_m = distance * unit_m
        if power and distance_m <= image_m:
            return None
        f_number = max(_f_number(distance_m, image_m=image_m, radius_m=radius * unit_m), MIN_F_NUMBER)
        if blur_px(distance_m, image_m=image_m, f_number=f_number) >= MIN_BLUR_PX:
            return unit_m, f_number
    return None


def _f_number(distance_m: float, *, image_m: float, radius_m: float) -> float:
    return 1 / (1 / image_m + 1 / distance_m) / (2 * radius_m) if radius_m else DEFAULT_F_NUMBER


def _scale(props: Any, units: float, *, image_m: float, path: Path) -> tuple[float, float, tuple[str, ...]]:
    """Return the metres per unit of a file, the f-number, and notes about both.

    A scene in which the lens would be in focus everywhere is made smaller.
    """
    radius = _aperture_radius(props, path)
    fit = fitting_scale(units, image_m=image_m, radius=radius)
    stated = _f_number(units, image_m=image_m, radius_m=radius)
    blur = blur_px(units, image_m=image_m, f_number=max(stated, MIN_F_NUMBER))
    text = f"{units:.4g} m away, f/{stated:.3g} blurs the target by {blur:.2g} pixels at the ends of the travel"
    if fit is None:
        raise BadInput(
            f"{text}, and no smaller scale helps",
            where=str(path),
            allowed=f"{MIN_BLUR_PX:g} pixels or more",
            hint="make the field of view narrower, open the aperture, or set it to 0, for which the card states f/2",
        )
    unit_m, f_number = fit
    notes = []
    if unit_m < 1:
        notes.append(f"scale: {text}; so the card has unit_m: {unit_m:g}, and it is {units * unit_m:.3g} m away")
    if not radius:
        notes.append(f"aperture: the camera is a pinhole, so the card says f/{DEFAULT_F_NUMBER:g}")
    elif f_number == MIN_F_NUMBER:
        wide = f"aperture_radius {radius:g} is f/{stated:.2g}, wider than any lens"
        notes.append(f"aperture: {wide}, so the card says f/{MIN_F_NUMBER:g}")
    return unit_m, f_number, tuple(notes)


def _other_cameras(props: Any, others: list[Any]) -> Iterator[str]:
    """Yield a line that names the cameras that are not taken."""
    if others:
        how = "; --camera takes another" if _or(others) else ""
        yield f"cameras ignored: {some_of(map(_label, others))} ({_name(props)} is taken{how})"


def _label(props: Any) -> str:
    """Return the kind of a camera, and its id if it has one."""
    return f"{props.plugin_name()} {props.id()!r}" if props.id() else props.plugin_name()


def _name(props: Any) -> str:
    """Return the words for the camera that is taken; a camera without an id cannot be chosen."""
    return f"the camera {props.id()!r}" if props.id() else "the first perspective camera"


def _or(others: list[Any]) -> str:
    """Return the part of a hint that names the other cameras that can be chosen."""
    names = _ids(others)
    return f", or take another camera with --camera: {some_of(names)}" if names else ""


def _ids(cameras: list[Any]) -> list[str]:
    return [props.id() for props in cameras if props.plugin_name() in PERSPECTIVE and props.id()]


def _left_out(props: Any, read: SceneXml, *, film: Element | None, units: float) -> Iterator[str]:
    """Yield a line for each setting of the file that changes its picture but not that of the card."""
    for key, axis in (("principal_point_offset_x", "sideways"), ("principal_point_offset_y", "up or down")):
        if shift := _number(props, key):
            yield f"lens shift ignored: {key} {shift:g}, so the picture moves {axis} by {abs(shift):.0%} of its width"
    if (
        props.plugin_name() == "thinlens"
        and abs((focus := _number(props, "focus_distance")) / units - 1) > 0.01
        and focus
    ):
        yield f"focus_distance ignored: {focus:g} (the card's lens focuses from before to behind the target)"
    near, far = _number(props, "near_clip"), _number(props, "far_clip") or math.inf
    if not near <= units <= far:
        yield f"near_clip and far_clip ignored: {near:g} to {far:g} hide the target, {units:.4g} away"
    if _number(props, "shutter_close") > _number(props, "shutter_open"):
        yield "shutter ignored: motion is on the card, as keyframes"
    matrix = np.array(getattr(props.get("to_world", None), "matrix", np.eye(4)), dtype=np.float64)
    if np.linalg.det(matrix[:3, :3]) < 0:
        yield "mirror of the camera ignored: its to_world turns left into right"
    for element in read.ignored:
        values = {c.attributes.get("name"): c.attributes.get("value") for c in element.children}
        kind = element.attributes.get("type", "")
        if element.tag == "integrator" and kind not in ("path", "volpath", "volpathmis"):
            yield f"integrator ignored: {kind} (pictures have all light along complete paths)"
        if element.tag == "integrator" and values.get("hide_emitters") == "true":
            yield "hide_emitters ignored: lamps are visible"
        if element is film and {"crop_width", "crop_height", "crop_offset_x", "crop_offset_y"} & values.keys():
            yield "crop of the film ignored: the sensor shows the full field of view"
    (width, height), ours = _film_size(film), REFERENCE_GRID.columns / REFERENCE_GRID.rows
    if abs(width / height / ours - 1) >= 0.01:
        change = "more is seen" if width / height > ours else "less is seen"
        yield f"film size ignored: {width} × {height} (the width is kept; {change} at the top and bottom of 400 × 250)"
    for name in read.media:
        yield f"medium ignored: {name} (no fog, and no scattering inside)"


def _film_size(film: Element | None) -> tuple[int, int]:
    """Return the columns and rows of a film, those of the reference sensor if they are not stated."""
    values = {c.attributes.get("name"): c.attributes.get("value") or "" for c in film.children} if film else {}
    try:
        width, height = int(values["width"]), int(values["height"])
    except (KeyError, ValueError):
        return REFERENCE_GRID.columns, REFERENCE_GRID.rows
    return (width, height) if 0 < min(width, height) <= max(width, height) < 1 << 16 else (400, 250)


def _number(props: Any, key: str) -> float:
    """Return a number among a camera's properties, or 0."""
    value = props.get(key, 0.0)
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else 0.0


def _chosen_camera(read: SceneXml, path: Path, *, name: str) -> tuple[Any, Element | None, list[Any]]:
    """Return the properties of the first perspective camera, or of that of this name, and its film.

    Properties are upgraded from older versions of Mitsuba. Those of all other cameras are returned too.
    """
    config = mi.parser.ParserConfig("scalar_rgb")
    try:
        state = mi.parser.parse_string(config, read.cameras)
        mi.parser.transform_upgrade(config, state)
    except (RuntimeError, ValueError, TypeError) as error:
        raise parse_refusal(error, path) from error
    sensors = [node.props for node in state.nodes if node.type == mi.ObjectType.Sensor]
    able = [n for n, props in enumerate(sensors) if props.plugin_name() in PERSPECTIVE]
    if not able:
        raise BadInput(
            f"the scene has no perspective camera{', but ' + some_of(map(_label, sensors)) if sensors else ''}",
            where=str(path),
            allowed=", ".join(PERSPECTIVE),
            hint="export a perspective camera",
        )
    chosen = next((n for n in able if name in ("", sensors[n].id())), None)
    if chosen is None:
        hint = "" if len(ids := _ids(sensors)) == len(able) else "a camera without an id cannot be chosen: give it one"
        problem, nearest = f"unknown perspective camera {name!r}", closest(name, ids)
        raise BadInput(problem, where=str(path), allowed=some_of(ids, name), nearest=nearest, hint=hint)
    return sensors[chosen], read.films[chosen], sensors[:chosen] + sensors[chosen + 1 :]


def _pose(props: Any, path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the position of the camera and its unit vectors ahead and up, float64 (3,) each."""
    to_world = props.get("to_world", mi.ScalarTransform4f())
    matrix = np.array(getattr(to_world, "matrix", np.full((4, 4), np.nan)), dtype=np.float64)
    lengths = np.linalg.norm(matrix[:3, 1:3], axis=0)
    if not (np.isfinite(matrix).all() and (lengths > 0).all()):
        raise BadInput("to_world of the camera gives it no direction", where=str(path), hint="export the scene again")
    up, ahead = (matrix[:3, 1:3] / lengths).T
    return matrix[:3, 3], ahead, up


def _field_of_view(props: Any, size: tuple[int, int], *, path: Path) -> float:
    """Return the horizontal field of view (degrees) on a film of this many columns and rows, as Mitsuba computes it.

    The file states a field of view along some axis, or, as text, the focal length of a lens with the same diagonal
    field on a frame of 36 × 24 mm. If it states neither, the focal length is 50 mm.
    """
    properties = {key: props[key] for key in ("fov", "fov_axis", "focal_length") if key in props}
    try:
        film = {"type": "hdrfilm", "width": size[0], "height": size[1]}
        camera = mi.load_dict({"type": "perspective", **properties, "film": film})
    except (RuntimeError, ValueError, TypeError) as error:
        message = re.split(r"\[[\w.]+:\d+\] ", str(error))[-1]
        raise BadInput(f"the camera's field of view: {message}", where=str(path)) from error
    field = float(mi.traverse(camera)["x_fov"])
    if not 0 < field < 180:
        raise BadInput(
            f"the camera's field of view is {field:g} degrees", where=str(path), allowed="above 0, below 180"
        )
    return field


def _aperture_radius(props: Any, path: Path) -> float:
    """Return the radius of the file's aperture in units of the file, 0 for a pinhole."""
    radius = props.get("aperture_radius", 0.0)
    if not (isinstance(radius, int | float) and 0 <= radius < math.inf):
        raise BadInput(
            f"aperture_radius of the camera is {radius!r}",
            where=str(path),
            allowed="a length in metres, or 0 for a pinhole",
        )
    return float(radius)


def _light_groups(lamps: list[str]) -> dict[str, str]:
    """Return one light group per lamp, named after the lamp without the prefix that exporters add.

    A name that is already used, or reserved, gets a suffix.
    """
    groups: dict[str, str] = {}
    for lamp in lamps:
        bare = re.sub(r"^(emit|mesh|light)[-_]", "", lamp.lower())
        name = re.sub(r"[^a-z0-9]+", "_", bare).strip("_") or "lamp"
        if name in RESERVED_GROUP_NAMES:
            name += "_lamp"
        while name in groups:
            name += "_2"
        groups[name] = lamp
    return groups
