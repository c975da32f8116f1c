"""Builds a Mitsuba scene from a scene folder, poses its shapes, and lights it with some of its emitters.

The scene is plain XML, whose names are kept, or the result of its ``scene.py``. Only scenes from
:func:`saf_gen.scene.scene_folder.find_scene` may have a script.
"""

import importlib.util
import os
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import mitsuba as mi
import numpy as np
from pydantic import ValidationError

from saf_gen.core.user_code import user_code
from saf_gen.errors import BadInput, unknown
from saf_gen.render import meshes
from saf_gen.render.backend import read_picture
from saf_gen.render.mitsuba_words import load_refusal, parse_refusal
from saf_gen.render.scene_values import check_meshes, check_values
from saf_gen.scene.keyframes import RigidMotion
from saf_gen.scene.scene_folder import Scene
from saf_gen.scene.xml import ALLOWED_PLUGINS, read_scene_xml


def scene_dict(scene: Scene) -> dict[str, Any]:
    """Return the Mitsuba dictionary of a scene, with all its emitters, checked against the card.

    It is read from ``scene.xml``, or built by ``build(params)`` of ``scene.py``.

    Raises BadInput if the geometry cannot be read or built, if it lacks a name that is on the card, or if an emitter
    belongs to no light group.
    """
    with meshes.normals_in_order():
        described = _read_geometry(scene)
    check_values(described, where=str(scene.folder / ("scene.py" if scene.has_script else "scene.xml")))
    lamps = emitter_names(described)
    shapes = shape_names(described)
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


def shape_names(described: Mapping[str, Any]) -> list[str]:
    """Return the names of the entries that may be a target: shapes, and shapes that instances show."""
    return [name for name, entry in described.items() if _is_shape(entry)] + list(instances_by_shape(described))


def emitter_names(described: Mapping[str, Any]) -> list[str]:
    """Return the names of the entries that emit light: lamps, and shapes with a lamp in them."""
    return [name for name, entry in described.items() if _emits(entry)]


def instances_by_shape(described: Mapping[str, Any]) -> dict[str, list[str]]:
    """Return the instances that show each shape of a shape group, by the shape's name."""
    found: dict[str, list[str]] = {}
    for name, entry in described.items():
        if _plugin_name(entry) != "instance":
            continue
        groups = [described.get(value["id"]) for value in entry.values() if _plugin_name(value) == "ref"]
        for group in (g for g in groups if isinstance(g, dict)):
            for key, inner in group.items():
                if isinstance(inner, dict | mi.Shape) and _is_shape(inner):
                    shape = inner.get("id", key) if isinstance(inner, dict) else inner.id()
                    found.setdefault(str(shape), []).append(name)
    return found


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


def load_lit_scene(
    described: Mapping[str, Any], emitters: tuple[str, ...], *, max_depth: int, where: str = ""
) -> tuple[Any, Any]:
    """Return the Mitsuba scene with only these emitters, and the integrator that traces it.

    The other emitters are left out rather than dimmed, so that no sample is spent on a dark lamp. Their shapes stay and
    still cast shadows. ``where`` is the file of the scene, for messages.

    Raises BadInput if Mitsuba cannot load the scene.
    """
    lit = {name: entry if name in emitters else _without_light(entry) for name, entry in described.items()}
    lit = {name: entry for name, entry in lit.items() if entry is not None}
    lit = dict(_keyed(name, entry, taken=lit) for name, entry in lit.items())
    try:
        lit = _with_shared_surfaces(lit)
        # One thread loads the scene: several would number the shapes in the order in which they finish. These
        # numbers are part of a kernel's code, so every load would compile its kernels again.
        loaded = mi.load_dict({"type": "scene", **lit}, parallel=False, optimize=False)
        meshes.settle_files(loaded, {"type": "scene", **lit})
    except (RuntimeError, ValueError, TypeError, KeyError) as error:
        raise load_refusal(error, names=tuple(lit), where=where) from error
    check_meshes(loaded, described, where=where)
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
        return parse_scene_dict(read_scene_xml(path, scene.params).text, path)
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


def _with_shared_surfaces(described: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scene with its pictures read, in which shapes that a script gives the same BSDF have the same one.

    Dr.Jit goes through all of a scene's BSDFs whenever it prepares a kernel, however small: with one for each of 170
    bubbles, that took most of the time.
    """
    inner = [value for entry in described.values() if isinstance(entry, dict) for value in entry.values()]
    surfaces = {id(v): v for v in inner if _plugin_name(v) in ALLOWED_PLUGINS["bsdf"] and not _refers(v)}
    uses = Counter(id(value) for value in inner)
    made = {
        key: mi.load_dict(_with_pictures(surface), parallel=False, optimize=False)
        for key, surface in surfaces.items()
        if uses[key] > 1
    }
    return {
        name: _with_pictures({key: made.get(id(value), value) for key, value in entry.items()})
        if isinstance(entry, dict)
        else entry
        for name, entry in described.items()
    }


def _refers(entry: Any) -> bool:
    return isinstance(entry, dict) and (entry.get("type") == "ref" or any(map(_refers, entry.values())))


def _with_pictures(entry: Any) -> Any:
    """Return an entry with its OpenEXR pictures read, which takes several threads: on one, Mitsuba waits for ever."""
    if not isinstance(entry, dict):
        return entry
    file = entry.get("filename")
    if _plugin_name(entry) in ("bitmap", "envmap") and isinstance(file, str) and file.lower().endswith(".exr"):
        rest = {key: value for key, value in entry.items() if key != "filename"}
        return {**rest, "bitmap": read_picture(str(mi.file_resolver().resolve(file)))}  # type: ignore[operator]
    return {key: _with_pictures(value) for key, value in entry.items()}


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
    return isinstance(mi.load_dict(_with_pictures(value)), mi.BSDF)


UNPOSABLE_TYPES = ("constant", "shapegroup")  # entries on which a pose would have no effect


def validate_motions(document: Any, where: str) -> dict[str, RigidMotion]:
    """Validate the result of a script's ``motion(params)``, and return the motion of each shape.

    ``document`` has the form of ``motion`` on the card; a motion may also be a RigidMotion. ``where`` names the script.
    Raises BadInput for anything else.
    """
    if not isinstance(document, Mapping):
        raise BadInput(
            f"motion() returned {type(document).__name__}",
            where=where,
            allowed="a dictionary of shapes, like motion on the card",
        )
    motions = {}
    for name, motion in document.items():
        try:
            motions[str(name)] = RigidMotion.model_validate(motion)
        except ValidationError as error:
            first = error.errors()[0]
            at = ".".join(str(key) for key in first["loc"])
            what = f"the motion of {name!r}" + (f": {at}" if at else "")
            allowed = first["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
            raise BadInput(f"{what} is {first['input']!r}", where=where, allowed=allowed) from error
    return motions


def pose_shapes(
    described: Mapping[str, Any], motions: Mapping[str, RigidMotion], *, time_s: float, unit_m: float = 1.0
) -> dict[str, Any]:
    """Return the scene at a time, with every moving top-level entry displaced from its position as built.

    Parameters
    ----------
    described : mapping of str
        Scene from :func:`saf_gen.render.mitsuba_scene.scene_dict`; it is not changed. A moving shape or
        lamp may be a dictionary; a shape may also be an ``mi.Mesh``, which is copied.
    motions : mapping of str to RigidMotion
        Motions by entry.
    time_s : float
        Time, in seconds.
    unit_m : float, default 1.0
        Metres per unit of the scene.

    Raises
    ------
    BadInput
        If a name is unknown, or an entry cannot be moved.
    """
    moved = dict(described)
    for name, motion in motions.items():
        if name not in described:
            raise unknown("moving shape", name, allowed=described)
        pose = motion.pose_at(time_s)
        if not np.array_equal(pose, np.eye(4)):
            pose[:3, 3] /= unit_m
            moved[name] = _move_entry(name, described[name], pose=pose)
    return moved


def moved_shapes(motions: Mapping[str, RigidMotion], *, time_s: float, still_s: float) -> dict[str, np.ndarray]:
    """Return the displacement (m) of each shape since ``still_s``, without its rotation, float64 (3,)."""
    return {name: motion.shift_at(time_s) - motion.shift_at(still_s) for name, motion in motions.items()}


def _move_entry(name: str, entry: Any, *, pose: np.ndarray) -> Any:
    if meshes.has_vertices(entry) and not entry.is_emitter():
        return meshes.move_mesh(entry, pose)
    if not isinstance(entry, dict) or entry.get("type") in UNPOSABLE_TYPES:
        plugin = entry.get("type") if isinstance(entry, dict) else type(entry).__name__
        raise BadInput(
            f"{name!r}, of type {plugin}, cannot be moved",
            allowed="a shape or a lamp as a dictionary, or an mi.Mesh that emits no light",
        )
    entry = dict(entry)
    to_world = entry.pop("to_world", mi.ScalarTransform4f())
    if entry["type"] == "point" and "position" in entry:  # a lamp has a position or a transform, not both
        to_world = mi.ScalarTransform4f().translate(entry.pop("position"))
    return {**entry, "to_world": mi.ScalarTransform4f(pose.tolist()) @ to_world}


def parse_scene_dict(text: str, path: Path) -> dict[str, Any]:
    """Return the Mitsuba dictionary of a scene from :func:`saf_gen.scene.xml.read_scene_xml`, by id.

    A lamp is copied to every shape that refers to it; surfaces, textures and the like stay shared. ``path`` is the
    file, for messages. Raises BadInput if Mitsuba does not understand the scene.
    """
    variant: Any = mi.variant()  # the stubs allow None, but a backend has been activated
    config = mi.parser.ParserConfig(variant)
    config.merge_equivalent = config.merge_meshes = False
    try:
        state = mi.parser.parse_string(config, text)
        mi.parser.transform_all(config, state)
    except (RuntimeError, ValueError, TypeError) as error:
        raise parse_refusal(error, path) from error
    top = [v.index() for _, v in state.root.props.items() if isinstance(v, mi.Properties.ResolvedReference)]
    entries = {state.nodes[i].props.id(): _entry(state, i, shared=frozenset(top)) for i in top}
    return {name: entry for name, entry in entries.items() if entry["type"] != "area"}


def _entry(state: Any, index: int, *, shared: frozenset[int]) -> dict[str, Any]:
    """Return the dictionary of a node; nodes in ``shared``, except lamps, become references."""
    props = state.nodes[index].props
    entry: dict[str, Any] = {"type": props.plugin_name()}
    for key, value in props.items():
        key = re.sub(r"^_arg_", "part_", key)
        if isinstance(value, mi.Properties.ResolvedReference):
            inner = value.index()
            lamp = state.nodes[inner].type == mi.ObjectType.Emitter
            if inner in shared and not lamp:
                entry[key] = {"type": "ref", "id": state.nodes[inner].props.id()}
            else:
                entry[key] = _entry(state, inner, shared=shared)
                if entry["type"] == "shapegroup" and state.nodes[inner].type == mi.ObjectType.Shape:
                    entry[key]["id"] = state.nodes[inner].props.id()  # it may be a target
        elif isinstance(value, mi.ScalarAffineTransform4d):  # the parser gives doubles
            entry[key] = mi.ScalarTransform4f(np.array(value.matrix, dtype=np.float64).tolist())
        else:
            entry[key] = value
    return entry


def call_scene_script(scene: Scene, function: str, *, default: Any = None) -> Any:
    """Call a function of the scene's script with the scene's parameters, and return its result.

    If the script has no function of this name, return ``default``, unless that is None.

    Raises BadInput, with a one-line message, if the script raises anything.
    """
    script = scene.folder / "scene.py"
    limit = sys.getrecursionlimit()
    with _kept_process(script), _scene_modules(scene):
        try:
            with user_code():
                try:
                    module = _execute(f"saf_gen_scene_{scene.id}", script)
                    if default is not None and not hasattr(module, function):
                        return default
                    return getattr(module, function)(scene.script_params)
                finally:
                    sys.setrecursionlimit(limit)  # here, because no further function could be called under a low one
        except BadInput:
            raise
        except Exception as error:  # the code of a scene may raise anything
            raise BadInput(f"{script} failed: {type(error).__name__}: {error}".rstrip(": ")) from error


@contextmanager
def _kept_process(script: Path) -> Iterator[None]:
    """Put back what a script may change for its whole process: standard streams, working folder, environment.

    Other scenes are rendered by the same process. A file that is opened under the number of a closed standard stream
    would receive what is printed. Raises BadInput if the script has closed descriptors that it did not open.
    """
    streams = {number: os.dup(number) for number in range(3) if _is_open(number)}
    objects, folder, environment = (sys.stdin, sys.stdout, sys.stderr), Path.cwd(), dict(os.environ)
    try:
        yield
    finally:
        sys.stdin, sys.stdout, sys.stderr = objects
        with suppress(OSError):
            os.chdir(folder)
        if dict(os.environ) != environment:
            os.environ.clear()
            os.environ.update(environment)
        try:
            for number, copy in streams.items():
                os.dup2(copy, number)
                os.close(copy)
        except OSError as error:  # the copies are closed, too, and so may be all that this process needs
            raise BadInput(f"{script} closed files that it did not open", hint="repair it") from error


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


def _execute(name: str, file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise BadInput(f"{file} cannot be loaded")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@contextmanager
def _scene_modules(scene: Scene) -> Iterator[None]:
    """Let scene.py import its neighbours and what its card takes from the kit, and forget these modules afterwards.

    Two scenes may thus have different modules of the same name.
    """
    before = dict(sys.modules)
    files = scene.kit_files()
    sys.path.insert(0, str(scene.folder))
    try:
        for name, file in files.items():
            sys.modules[name] = _execute(name, file)  # those after it may import it
        yield
    finally:
        sys.path.remove(str(scene.folder))
        for name in set(sys.modules) - set(before):
            origin = getattr(sys.modules[name], "__file__", None)
            if name in files or (origin and Path(origin).parent == scene.folder):
                del sys.modules[name]
        sys.modules.update({name: before[name] for name in files if name in before})
