"""Builds a Mitsuba scene from a scene folder, and lights it with some of its emitters."""

from collections.abc import Mapping
from typing import Any

import mitsuba as mi

from saf_gen.errors import BadInput, unknown
from saf_gen.render import xml_scene
from saf_gen.render.backend import on_one_thread
from saf_gen.render.posed_shapes import validate_motions
from saf_gen.render.scene_script import call_scene_script
from saf_gen.scene.keyframes import RigidMotion
from saf_gen.scene.scene_folder import Scene
from saf_gen.scene.xml import ALLOWED_PLUGINS, read_scene_xml


def scene_dict(scene: Scene) -> dict[str, Any]:
    """Return the Mitsuba dictionary of a scene, with all its emitters, checked against the card.

    It is read from ``scene.xml``, or built by ``build(params)`` of ``scene.py``.

    Raises BadInput if the geometry cannot be read or built, if it lacks a name that is on the card, or if an emitter
    belongs to no light group.
    """
    with on_one_thread():
        described = _read_geometry(scene)
    lamps = emitter_names(described)
    shapes = [name for name, entry in described.items() if _is_shape(entry)]
    card = str(scene.folder / "scene.yaml")
    for group, names in scene.card.lights.items():
        for name in names:
            if name not in lamps:
                raise unknown(f"emitter of light group {group!r}:", name, allowed=lamps, where=card)
    for name in scene.card.target:
        if name not in shapes:
            raise unknown("target shape", name, allowed=shapes, where=card)
    listed = {name for names in scene.card.lights.values() for name in names}
    for name in lamps:
        if name not in listed:
            raise BadInput(f"the emitter {name!r} belongs to no light group", where=card, hint="list it under lights")
    return described


def emitter_names(described: Mapping[str, Any]) -> list[str]:
    """Return the names of the entries that emit light: lamps, and shapes with a lamp in them."""
    return [name for name, entry in described.items() if _emits(entry)]


def shape_motions(scene: Scene, described: Mapping[str, Any]) -> dict[str, RigidMotion]:
    """Return the motions of a scene's shapes, from the card and from ``motion(params)`` of its script.

    ``described`` is the dictionary from :func:`scene_dict`. The result is empty if nothing moves.

    Raises BadInput if the script fails, a motion is invalid, a shape has two motions, or a moving shape does not exist.
    """
    card, script = str(scene.folder / "scene.yaml"), str(scene.folder / "scene.py")
    moving = {name: (motion, card) for name, motion in scene.card.motion.items()}
    scripted = call_scene_script(scene, "motion", default={}) if scene.has_script else {}
    for name, motion in validate_motions(scripted, script).items():
        if name in moving:
            raise BadInput(f"{name!r} has a motion on the card and in motion()", where=script, hint="keep only one")
        moving[name] = (motion, script)
    for name, (_, where) in moving.items():
        if name not in described:
            raise unknown("moving shape", name, allowed=described, where=where)
    return {name: motion for name, (motion, _) in moving.items()}


def load_lit_scene(described: Mapping[str, Any], emitters: tuple[str, ...], *, max_depth: int) -> tuple[Any, Any]:
    """Return the Mitsuba scene with only these emitters, and the integrator that traces it.

    The other emitters are left out rather than dimmed, so that no sample is spent on a dark lamp. Their shapes stay and
    still cast shadows.

    Raises BadInput if Mitsuba cannot load the scene.
    """
    lit = {name: entry if name in emitters else _without_light(entry) for name, entry in described.items()}
    lit = {name: entry for name, entry in lit.items() if entry is not None}
    lit = dict(_keyed(name, entry, taken=lit) for name, entry in lit.items())
    try:
        # One thread loads the scene: several would number the shapes in the order in which they finish. These
        # numbers are part of a kernel's code, so every load would compile its kernels again.
        with on_one_thread():
            loaded = mi.load_dict({"type": "scene", **lit}, parallel=False, optimize=False)
    except (RuntimeError, ValueError, TypeError, KeyError) as error:
        raise BadInput(f"Mitsuba cannot load the scene: {error}") from error
    integrator = mi.load_dict({"type": "path", "max_depth": max_depth, "hide_emitters": False})
    return loaded, integrator


def camera_to_world(scene: Scene) -> Any:
    """Return the transform from camera space (looking along +z, x to the left) to the world, in scene units."""
    pose, unit = scene.card.camera, scene.card.unit_m
    origin, target = ([x / unit for x in point] for point in (pose.origin_m, pose.look_at_m))
    return mi.ScalarTransform4f().look_at(origin=origin, target=target, up=list(pose.up))


def _read_geometry(scene: Scene) -> dict[str, Any]:
    if not scene.has_script:
        path = scene.folder / "scene.xml"
        return xml_scene.parse_scene_dict(read_scene_xml(path, scene.params).text, path)
    described = call_scene_script(scene, "build")
    if not isinstance(described, dict):
        script = scene.folder / "scene.py"
        raise BadInput(f"build() of {script} returned {type(described).__name__}", allowed="a Mitsuba dictionary")
    return {name: entry for name, entry in described.items() if name != "type"}


def _keyed(name: str, entry: Any, *, taken: Mapping[str, Any]) -> tuple[str, Any]:
    """Return an entry under a key that Mitsuba accepts; the dot in Blender's Cube.001 would be a delimiter."""
    if "." not in name or not isinstance(entry, dict):
        return name, entry
    key = name.replace(".", "_")
    while key in taken:
        key += "_"
    return key, {"id": name, **entry}


def _plugin_name(entry: Any) -> str | None:
    return entry.get("type") if isinstance(entry, dict) else None


def _emits(entry: Any) -> bool:
    if isinstance(entry, mi.Emitter):
        return True
    if not isinstance(entry, dict):
        return isinstance(entry, mi.Shape) and entry.is_emitter()
    return _is_emitter(entry) or any(_is_emitter(value) for value in entry.values())


def _is_emitter(entry: Any) -> bool:
    return _plugin_name(entry) in ALLOWED_PLUGINS["emitter"] or isinstance(entry, mi.Emitter)


def _without_light(entry: Any) -> Any:
    """Return an entry without its light: a shape without the lamp in it, or None for a lamp without a shape."""
    if not _emits(entry):
        return entry
    if _is_emitter(entry):
        return None
    if not isinstance(entry, dict):
        raise BadInput(
            f"the shape {entry.id()!r} was made with its emitter inside",
            hint="give it as a dictionary with an emitter entry, so that its light can be turned off",
        )
    dark = {key: value for key, value in entry.items() if not _is_emitter(value)}
    if not any(_is_bsdf(value) for value in dark.values()):
        # Mitsuba makes a lamp without a BSDF black, and any other shape without one grey.
        dark["bsdf"] = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
    return dark


def _is_shape(entry: Any) -> bool:
    """Return whether an entry may be a target; an unknown plug-in may be one."""
    if not isinstance(entry, dict):
        return isinstance(entry, mi.Shape)
    others = set().union(*(names for tag, names in ALLOWED_PLUGINS.items() if tag != "shape"))
    return _plugin_name(entry) not in {*others, "scene", "ref", "shapegroup"}


def _is_bsdf(value: Any) -> bool:
    plugin = _plugin_name(value)
    if plugin is None or plugin == "ref" or any(plugin in names for names in ALLOWED_PLUGINS.values()):
        return isinstance(value, mi.BSDF) or plugin == "ref" or plugin in ALLOWED_PLUGINS["bsdf"]
    return isinstance(mi.load_dict(value), mi.BSDF)
