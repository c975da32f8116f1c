"""The camera of an exported scene as a card describes it: its pose, lens and target."""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.errors import BadInput
from saf_gen.plugins.lights import RESERVED_GROUP_NAMES
from saf_gen.render import backend, mitsuba_scene
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


def exported_camera(read: SceneXml, path: Path) -> ExportedCamera:
    """Return the first perspective camera of a scene; units are taken as metres.

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
    props = _first_camera(read.cameras, path)
    origin, ahead, up = _pose(props, path)
    loaded, _ = mitsuba_scene.load_lit_scene(described, tuple(lamps), max_depth=2)
    hit = loaded.ray_intersect(mi.Ray3f(origin.tolist(), ahead.tolist()))
    if not hit.is_valid():
        raise BadInput(
            "nothing is in the middle of the camera's image",
            where=str(path),
            hint="aim the camera at the target, and export again",
        )
    distance = float(hit.t)
    image = SENSOR_WIDTH_M / 2 / math.tan(math.radians(_field_of_view(props, path)) / 2)
    focal = 1 / (1 / image + 1 / distance)
    return ExportedCamera(
        name=f"{props.plugin_name()} camera",
        origin_m=tuple(origin.tolist()),
        look_at_m=tuple((origin + distance * ahead).tolist()),
        up=tuple(up.tolist()),
        focal_length_mm=focal * 1e3,
        f_number=_f_number(props, focal_length_m=focal, path=path),
        lights=_light_groups(lamps),
        target=hit.shape.id(),
        distance_m=distance,
    )


def _first_camera(cameras: str, path: Path) -> Any:
    """Return the properties of the first perspective camera, upgraded from older versions of Mitsuba."""
    config = mi.parser.ParserConfig("scalar_rgb")
    try:
        state = mi.parser.parse_string(config, cameras)
        mi.parser.transform_upgrade(config, state)
    except (RuntimeError, ValueError, TypeError) as error:
        raise mitsuba_scene.mitsuba_refusal(error, path) from error
    for node in state.nodes:
        if node.props.plugin_name() in ("perspective", "thinlens"):
            return node.props
    raise BadInput("the scene has no perspective camera", where=str(path), hint="export a perspective camera")


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


def _f_number(props: Any, *, focal_length_m: float, path: Path) -> float:
    """Return the f-number of the file's aperture, at least 1.

    A camera without an aperture radius, or with a radius of 0, is a pinhole and gets f/2.
    """
    radius = props.get("aperture_radius", 0.0)
    if not (isinstance(radius, int | float) and 0 <= radius < math.inf):
        raise BadInput(
            f"aperture_radius of the camera is {radius!r}",
            where=str(path),
            allowed="a length in metres, or 0 for a pinhole",
        )
    f_number = focal_length_m / (2 * radius) if radius > 0 else DEFAULT_F_NUMBER
    if f_number > MAX_F_NUMBER:
        raise BadInput(
            f"aperture_radius of the camera is {radius:g}, which is f/{f_number:.4g} with a sensor of 8 mm",
            where=str(path),
            allowed=f"up to f/{MAX_F_NUMBER:g}, which is {focal_length_m / 2 / MAX_F_NUMBER:.2g} m or more",
            hint="open the aperture, or set it to 0, for which the card states f/2",
        )
    return max(f_number, MIN_F_NUMBER)


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
