"""The camera of an exported scene as a card describes it: its pose, lens and target."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.errors import BadInput
from saf_gen.plugins.lights import RESERVED_GROUP_NAMES
from saf_gen.render import backend, mitsuba_scene
from saf_gen.render.mitsuba_words import parse_refusal
from saf_gen.render.pinhole_sight import PinholeSight
from saf_gen.render.render_setup import SensorGrid, film_dict
from saf_gen.scene.xml import SceneXml

REFERENCE_GRID = SensorGrid(rows=250, columns=400, pitch_m=20e-6)
SENSOR_WIDTH_M = REFERENCE_GRID.columns * REFERENCE_GRID.pitch_m
MIN_F_NUMBER, DEFAULT_F_NUMBER, MAX_F_NUMBER = (1.0, 2.0, 64.0)  # default for a pinhole; a card allows up to 64


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
    target : str
        Id of the shape that the optical axis meets.
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
    target: str
    distance_m: float
    unit_m: float = 1.0
    notes: tuple[str, ...] = ()


def exported_camera(read: SceneXml, path: Path) -> ExportedCamera:
    """Return the first perspective camera of a scene, aimed at the first opaque surface behind all clear ones.

    Units are metres, unless no lens could focus at such distances and another unit explains them.

    Parameters
    ----------
    read : SceneXml
        Scene that was read from the file.
    path : Path
        File of the scene, for messages.

    Returns
    -------
    ExportedCamera
        The camera; its f-number follows from the file's aperture, and is 2 for a pinhole.

    Raises
    ------
    BadInput
        If the scene has no perspective camera, no lamp, or nothing in the middle of the image, if the camera is
        invalid, or if its aperture is smaller than a card allows.
    """
    backend.activate_backend("scalar")
    described = mitsuba_scene.parse_scene_dict(read.text, path)
    lamps = mitsuba_scene.emitter_names(described)
    if not lamps:
        raise BadInput("the scene has no lamp", where=str(path), hint="export its lamps, or add a lamp")
    props, others = _first_camera(read.cameras, path)
    origin, ahead, up = _pose(props, path)
    loaded, _ = mitsuba_scene.load_lit_scene(described, tuple(lamps), max_depth=2, where=str(path))
    sight = PinholeSight(loaded, ())
    ends = sight.follow(origin[None], ahead[None])
    if not ends.seen[0]:
        raise BadInput(
            "nothing is in the middle of the camera's image",
            where=str(path),
            hint="aim the camera at the target, and export again",
        )
    # The line may go on through clear surfaces, and end behind them or nowhere.
    number, instance, point = ends.at_last(0)
    units = float(ahead @ (point - origin))
    unit_m, unit_note = _guess_unit(units, field=_field_of_view(props, path))
    distance = units * unit_m
    image = SENSOR_WIDTH_M / 2 / math.tan(math.radians(_field_of_view(props, path)) / 2)
    focal = 1 / (1 / image + 1 / distance)
    f_number, f_note = _f_number(props, focal_length_m=focal, unit_m=unit_m, path=path)
    return ExportedCamera(
        name=f"{props.plugin_name()} camera",
        origin_m=tuple((origin * unit_m).tolist()),
        look_at_m=tuple(((origin + units * ahead) * unit_m).tolist()),
        up=tuple(up.tolist()),
        focal_length_mm=focal * 1e3,
        f_number=f_number,
        lights=_light_groups(lamps),
        target=sight.name_of(instance) or sight.name_of(number),
        distance_m=distance,
        unit_m=unit_m,
        notes=(*unit_note, *f_note, *_left_out(props, others, read=read, units=units)),
    )


MIN_BLUR_PX = 4.0  # at the ends of the travel that the card gets; with less, no method finds the focus
UNITS = {"metres": 1.0, "centimetres": 1e-2, "millimetres": 1e-3, "micrometres": 1e-6}
TRAVEL = (1.5, 0.75)  # object distances in focus at positions 0 and 1, over the target's distance


def fitting_units(distance: float, *, image_m: float) -> dict[str, float]:
    """Return the units, and their metres, in which a lens of f/1 can blur a target at this distance.

    ``image_m`` is the distance of the sensor from the lens (m). The lens travels from 0.75 to 1.5 times the distance;
    the blur at the worse end is at least 4 pixels of the reference sensor. Objects nearer than three image distances
    are left out.
    """
    fit = {}
    for name, unit_m in UNITS.items():
        distance_m = distance * unit_m
        diameter = 1 / (1 / image_m + 1 / distance_m)  # of a lens of f/1, its focal length
        blur = diameter * image_m * (1 / min(TRAVEL) - 1) / distance_m
        if distance_m > 3 * image_m and blur >= MIN_BLUR_PX * REFERENCE_GRID.pitch_m:
            fit[name] = unit_m
    return fit


def _guess_unit(units: float, *, field: float) -> tuple[float, tuple[str, ...]]:
    """Return the metres per unit of a file, and a note if they are not metres for certain.

    Evidence against metres: at the target's distance no lens of f/1 with this field of view (degrees) blurs anything.
    """
    fit = fitting_units(units, image_m=SENSOR_WIDTH_M / 2 / math.tan(math.radians(field) / 2))
    if "metres" in fit or not fit:
        return 1.0, ()
    far = f"the target is {units:.4g} units away, too far for any blur if they are metres"
    if len(fit) > 1:
        choices = " or ".join(f"{unit_m:g} for {name}" for name, unit_m in fit.items())
        return 1.0, (f"units: {far}; set unit_m on the card ({choices}) and scale its lengths in metres by the same",)
    [(name, unit_m)] = fit.items()
    return unit_m, (f"units: {far}; the scene looks like {name}, so the card has unit_m: {unit_m:g}",)


def _left_out(props: Any, others: list[str], *, read: SceneXml, units: float) -> Iterator[str]:
    """Yield a line for each setting of the file that changes its picture but not that of the card."""
    for name in others:
        yield f"camera ignored: {name} (the first perspective camera is taken)"
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
        if element.tag == "film" and {"crop_width", "crop_height", "crop_offset_x", "crop_offset_y"} & values.keys():
            yield "crop of the film ignored: the sensor shows the full field of view"
        if element.tag == "film" and (note := _aspect_note(values)):
            yield note
    for name in read.media:
        yield f"medium ignored: {name} (no fog, and no scattering inside)"


def _aspect_note(values: dict[str | None, str | None]) -> str:
    try:
        width, height = float(values["width"] or ""), float(values["height"] or "")
    except (KeyError, ValueError):
        return ""
    ours = REFERENCE_GRID.columns / REFERENCE_GRID.rows
    if abs(width / height / ours - 1) < 0.01:
        return ""
    return f"film size ignored: {width:g} × {height:g} (the sensor is 400 × 250, so the picture has another height)"


def _number(props: Any, key: str) -> float:
    """Return a number among a camera's properties, or 0."""
    value = props.get(key, 0.0)
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else 0.0


def _first_camera(cameras: str, path: Path) -> tuple[Any, list[str]]:
    """Return the properties of the first perspective camera, upgraded from older versions of Mitsuba.

    The names of all other cameras are returned too.
    """
    config = mi.parser.ParserConfig("scalar_rgb")
    try:
        state = mi.parser.parse_string(config, cameras)
        mi.parser.transform_upgrade(config, state)
    except (RuntimeError, ValueError, TypeError) as error:
        raise parse_refusal(error, path) from error
    sensors = [node.props for node in state.nodes if node.type == mi.ObjectType.Sensor]
    names = [f"{props.plugin_name()} {props.id()!r}" for props in sensors]
    for n, props in enumerate(sensors):
        if props.plugin_name() in ("perspective", "thinlens"):
            return props, names[:n] + names[n + 1 :]
    raise BadInput(
        f"the scene has no perspective camera{', but ' + ', '.join(names) if names else ''}",
        where=str(path),
        allowed="perspective, thinlens",
        hint="export a perspective camera",
    )


def _pose(props: Any, path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the position of the camera and its unit vectors ahead and up, float64 (3,) each."""
    to_world = props.get("to_world", mi.ScalarTransform4f())
    matrix = np.array(getattr(to_world, "matrix", np.full((4, 4), np.nan)), dtype=np.float64)
    lengths = np.linalg.norm(matrix[:3, 1:3], axis=0)
    if not (np.isfinite(matrix).all() and (lengths > 0).all()):
        raise BadInput("to_world of the camera gives it no direction", where=str(path), hint="export the scene again")
    up, ahead = (matrix[:3, 1:3] / lengths).T
    return matrix[:3, 3], ahead, up


def _field_of_view(props: Any, path: Path) -> float:
    """Return the horizontal field of view (degrees) on our 8:5 sensor, as Mitsuba computes it.

    The file states a field of view along some axis, or, as text, the focal length of a lens with the same diagonal
    field on a frame of 36 × 24 mm. If it states neither, the focal length is 50 mm.
    """
    properties = {key: props[key] for key in ("fov", "fov_axis", "focal_length") if key in props}
    try:
        camera = mi.load_dict({"type": "perspective", **properties, "film": film_dict(REFERENCE_GRID)})
    except (RuntimeError, ValueError, TypeError) as error:
        message = re.split(r"\[[\w.]+:\d+\] ", str(error))[-1]
        raise BadInput(f"the camera's field of view: {message}", where=str(path)) from error
    field = float(mi.traverse(camera)["x_fov"])
    if not 0 < field < 180:
        raise BadInput(
            f"the camera's field of view is {field:g} degrees", where=str(path), allowed="above 0, below 180"
        )
    return field


def _f_number(props: Any, *, focal_length_m: float, unit_m: float, path: Path) -> tuple[float, tuple[str, ...]]:
    """Return the f-number of the file's aperture, at least 1, and a note if the file says otherwise.

    A camera without an aperture radius, or with a radius of 0, is a pinhole and gets f/2.
    """
    radius = props.get("aperture_radius", 0.0)
    if not (isinstance(radius, int | float) and 0 <= radius < math.inf):
        raise BadInput(
            f"aperture_radius of the camera is {radius!r}",
            where=str(path),
            allowed="a length in metres, or 0 for a pinhole",
        )
    if radius == 0:
        return DEFAULT_F_NUMBER, (f"aperture: the camera is a pinhole, so the card says f/{DEFAULT_F_NUMBER:g}",)
    f_number = focal_length_m / (2 * radius * unit_m)
    if f_number > MAX_F_NUMBER:
        raise BadInput(
            f"aperture_radius of the camera is {radius:g}, which is f/{f_number:.4g} with a sensor of 8 mm",
            where=str(path),
            allowed=f"up to f/{MAX_F_NUMBER:g}, which is {focal_length_m / 2 / MAX_F_NUMBER:.2g} m or more",
            hint="open the aperture, or set it to 0, for which the card states f/2",
        )
    if f_number < MIN_F_NUMBER:
        wide = f"aperture_radius {radius:g} is f/{f_number:.2g}, wider than any lens"
        return MIN_F_NUMBER, (f"aperture: {wide}, so the card says f/{MIN_F_NUMBER:g}",)
    return f_number, ()


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
