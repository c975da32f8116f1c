"""The camera that an exported scene brings, as a card has it: its place, its lens, what it looks at."""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.errors import BadInput
from saf_gen.render import from_xml, variant, world
from saf_gen.scene_xml import SceneXml

__all__ = ["Camera", "camera_of"]

SENSOR_WIDTH_M = 400 * 20e-6
WIDEST_F_NUMBER, USUAL_F_NUMBER = 1.0, 2.0


@dataclass(frozen=True)
class Camera:
    """A pose (m), a lens on a sensor 8 mm wide, and what it sees.

    lights : light group to emitter. target : the shape that the axis meets, distance_m away.
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


def camera_of(read: SceneXml, path: Path) -> Camera:
    """The first perspective camera of a scene, which ``path`` names in messages; units are taken as metres.

    The f-number is that of the file where it has an aperture, else 2.

    Raises BadInput where there is no such camera, no lamp, or nothing in the middle of its picture.
    """
    variant.use("scalar")
    described = from_xml.described(read.text, path)
    lamps = world.emitters(described)
    if not lamps:
        raise BadInput("the scene has no lamp", where=str(path), hint="export its lamps, or add one")
    state = mi.parser.parse_string(mi.parser.ParserConfig("scalar_rgb"), read.cameras)
    mi.parser.transform_upgrade(mi.parser.ParserConfig("scalar_rgb"), state)
    known = [n.props for n in state.nodes if n.props.plugin_name() in ("perspective", "thinlens")]
    if not known:
        raise BadInput("the scene has no perspective camera", where=str(path), hint="export one")
    props = known[0]
    matrix = np.array(props.get("to_world", mi.ScalarTransform4f()).matrix, dtype=np.float64)
    origin, ahead = matrix[:3, 3], matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    up = matrix[:3, 1] / np.linalg.norm(matrix[:3, 1])
    loaded, _ = world.load(described, tuple(lamps), 2)
    hit = loaded.ray_intersect(mi.Ray3f(origin.tolist(), ahead.tolist()))
    if not hit.is_valid():
        raise BadInput(
            "nothing lies in the middle of the camera's picture",
            where=str(path),
            hint="aim the camera at the target, and export again",
        )
    distance = float(hit.t)
    image = SENSOR_WIDTH_M / 2 / math.tan(math.radians(_field(props)) / 2)
    focal = 1 / (1 / image + 1 / distance)
    radius = float(props.get("aperture_radius", focal / (2 * USUAL_F_NUMBER)))
    return Camera(
        name=f"{props.plugin_name()} camera",
        origin_m=tuple(origin.tolist()),
        look_at_m=tuple((origin + distance * ahead).tolist()),
        up=tuple(up.tolist()),
        focal_length_mm=focal * 1e3,
        f_number=max(focal / (2 * radius), WIDEST_F_NUMBER),
        lights=_groups(lamps),
        target=hit.shape.id(),
        distance_m=distance,
    )


def _field(props: Any) -> float:
    """Horizontal field of view (degrees) on our film of 8:5, whichever axis the file gives it for."""
    field, axis = float(props.get("fov", 39.6)), str(props.get("fov_axis", "x"))
    half = math.tan(math.radians(field) / 2)
    across = {"y": 1.6, "smaller": 1.6, "diagonal": 1.6 / math.hypot(1.6, 1)}.get(axis, 1.0)
    return 2 * math.degrees(math.atan(half * across))


def _groups(lamps: list[str]) -> dict[str, str]:
    """A light group a lamp, called as the lamp is without what exporters put before the name."""
    groups: dict[str, str] = {}
    for lamp in lamps:
        name = (
            re.sub(r"[^a-z0-9]+", "_", re.sub(r"^(emit|mesh|light)[-_]", "", lamp.lower())).strip("_")
            or "lamp"
        )
        while name in groups:
            name += "_2"
        groups[name] = lamp
    return groups
