"""Shapes that move: who says how, and the scene as it stands at a time."""

from collections.abc import Mapping
from typing import Any

import mitsuba as mi
import numpy as np
from pydantic import ValidationError

from saf_gen.errors import BadInput, unknown
from saf_gen.scene.keyframes import RigidMotion

__all__ = ["pose_shapes", "validate_motions"]

UNPOSABLE_TYPES = ("constant", "shapegroup")  # entries that a pose would leave as they are


def validate_motions(words: Any, where: str) -> dict[str, RigidMotion]:
    """What ``motion(params)`` of a script gave, checked: {shape: {keyframes: [...], axis, centre_m}}.

    The words are those of the card's ``motion``; a value may be a RigidMotion already. ``where`` names the
    script. Raises BadInput for anything else.
    """
    if not isinstance(words, Mapping):
        raise BadInput(
            f"motion() gave {type(words).__name__}",
            where=where,
            allowed="a dictionary of shapes, as motion on the card",
        )
    motions = {}
    for name, motion in words.items():
        try:
            motions[str(name)] = RigidMotion.model_validate(motion)
        except ValidationError as error:
            first = error.errors()[0]
            at = ".".join(str(key) for key in first["loc"])
            what = f"the motion of {name!r}" + (f": {at}" if at else "")
            said = first["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
            raise BadInput(f"{what} is {first['input']!r}", where=where, allowed=said) from error
    return motions


def pose_shapes(
    described: Mapping[str, Any], motions: Mapping[str, RigidMotion], time_s: float, *, unit_m: float = 1.0
) -> dict[str, Any]:
    """The scene at a time: every named top-level entry moved from where it was built; the others as they are.

    described : what :func:`saf_gen.render.mitsuba_scene.build_scene_dict` gave; nothing in it is changed.
    unit_m : metres in one
    unit of the scene. A shape or a lamp may be a dictionary, a shape also an ``mi.Mesh``, which is copied.

    Raises BadInput for a name that is not there, or an entry that cannot be moved.
    """
    moved = dict(described)
    for name, motion in motions.items():
        if name not in described:
            raise unknown("moving shape", name, described)
        pose = motion.pose_at(time_s)
        if not np.array_equal(pose, np.eye(4)):
            pose[:3, 3] /= unit_m
            moved[name] = _moved(name, described[name], pose)
    return moved


def _moved(name: str, entry: Any, pose: np.ndarray) -> Any:
    if isinstance(entry, mi.Mesh) and "vertex_positions" in mi.traverse(entry) and not entry.is_emitter():
        return _moved_mesh(entry, pose)  # a rectangle that was made already is an mi.Mesh without vertices
    if not isinstance(entry, dict) or entry.get("type") in UNPOSABLE_TYPES:
        kind = entry.get("type") if isinstance(entry, dict) else type(entry).__name__
        raise BadInput(
            f"{name!r}, of type {kind}, cannot be moved",
            allowed="a shape or a lamp as a dictionary, or an mi.Mesh that does not shine",
        )
    entry = dict(entry)
    at = entry.pop("to_world", mi.ScalarTransform4f())
    if entry["type"] == "point" and "position" in entry:  # it takes a position or a transform, not both
        at = mi.ScalarTransform4f().translate(entry.pop("position"))
    return {**entry, "to_world": mi.ScalarTransform4f(pose.tolist()) @ at}


MESH_ARRAYS = ("faces", "vertex_positions", "vertex_normals", "vertex_texcoords")


def _moved_mesh(mesh: Any, pose: np.ndarray) -> Any:
    """A copy of a mesh, elsewhere: same faces, surface and attributes."""
    props = mi.Properties()
    inside = {
        "bsdf": mesh.bsdf(),
        "interior": mesh.interior_medium(),
        "exterior": mesh.exterior_medium(),
        "face_normals": mesh.has_face_normals(),
        "flip_normals": mesh.has_flipped_normals(),
    }
    for key, value in inside.items():
        if value is not None:
            props[key] = value
    flags = {
        "has_vertex_normals": mesh.has_vertex_normals(),
        "has_vertex_texcoords": mesh.has_vertex_texcoords(),
    }
    counts = {"vertex": mesh.vertex_count(), "face": mesh.face_count()}
    copy = mi.Mesh(mesh.id(), counts["vertex"], counts["face"], props=props, **flags)
    copy.set_id(mesh.id())
    have, filled = mi.traverse(mesh), mi.traverse(copy)
    for part in MESH_ARRAYS:
        if part in have:
            filled[part] = have[part]
    vertices = np.array(have["vertex_positions"], dtype=np.float64).reshape(-1, 3)
    filled["vertex_positions"] = _flat(filled, "vertex_positions", vertices @ pose[:3, :3].T + pose[:3, 3])
    if "vertex_normals" in have:
        normals = np.array(have["vertex_normals"], dtype=np.float64).reshape(-1, 3)
        filled["vertex_normals"] = _flat(filled, "vertex_normals", normals @ pose[:3, :3].T)
    filled.update()
    for key in set(have.keys()) - set(filled.keys()):
        kind = key.split("_")[0]
        if kind in counts:
            copy.add_attribute(key, len(have[key]) // counts[kind], have[key])
    return copy


def _flat(parts: Any, key: str, values: np.ndarray) -> Any:
    return type(parts[key])(np.ascontiguousarray(values, dtype=np.float32).ravel())
