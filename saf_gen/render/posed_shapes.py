"""Shapes that move: checks of their motions, and the scene with its shapes posed at a time."""

from collections.abc import Mapping
from typing import Any

import mitsuba as mi
import numpy as np
from pydantic import ValidationError

from saf_gen.errors import BadInput, unknown
from saf_gen.scene.keyframes import RigidMotion

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
    if isinstance(entry, mi.Mesh) and "vertex_positions" in mi.traverse(entry) and not entry.is_emitter():
        return _move_mesh(entry, pose)  # an mi.Mesh made from a rectangle has no vertices
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


MESH_ARRAYS = ("faces", "vertex_positions", "vertex_normals", "vertex_texcoords")


def _move_mesh(mesh: Any, pose: np.ndarray) -> Any:
    """Return a moved copy of a mesh, with the same faces, surface and attributes."""
    props = mi.Properties()
    properties = {
        "bsdf": mesh.bsdf(),
        "interior": mesh.interior_medium(),
        "exterior": mesh.exterior_medium(),
        "face_normals": mesh.has_face_normals(),
        "flip_normals": mesh.has_flipped_normals(),
    }
    for key, value in properties.items():
        if value is not None:
            props[key] = value
    flags = {"has_vertex_normals": mesh.has_vertex_normals(), "has_vertex_texcoords": mesh.has_vertex_texcoords()}
    counts = {"vertex": mesh.vertex_count(), "face": mesh.face_count()}
    copy = mi.Mesh(mesh.id(), counts["vertex"], counts["face"], props=props, **flags)
    copy.set_id(mesh.id())
    source, moved = mi.traverse(mesh), mi.traverse(copy)
    for key in MESH_ARRAYS:
        if key in source:
            moved[key] = source[key]

    def store(key: str, values: np.ndarray) -> None:
        moved[key] = type(moved[key])(np.ascontiguousarray(values, dtype=np.float32).ravel())

    vertices = np.array(source["vertex_positions"], dtype=np.float64).reshape(-1, 3)
    store("vertex_positions", vertices @ pose[:3, :3].T + pose[:3, 3])
    if "vertex_normals" in source:
        normals = np.array(source["vertex_normals"], dtype=np.float64).reshape(-1, 3)
        store("vertex_normals", normals @ pose[:3, :3].T)
    moved.update()
    for key in set(source.keys()) - set(moved.keys()):
        element = key.split("_")[0]
        if element in counts:
            copy.add_attribute(key, len(source[key]) // counts[element], source[key])
    return copy
