"""The extent of a mesh in a file that Mitsuba can read."""

from pathlib import Path

import mitsuba as mi
import numpy as np

from saf_gen.errors import BadInput
from saf_gen.render import backend
from saf_gen.scene.ply_file import validate_ply

MITSUBA_MESHES = {".obj": "obj", ".ply": "ply"}
"""Mitsuba's plug-in for each file extension."""


def mesh_extent(path: Path) -> np.ndarray:
    """Return the smallest and largest coordinates of a mesh, float64 (2, 3), in units of the file.

    Raises BadInput if Mitsuba cannot read the file, or if the mesh has no face.
    """
    if path.suffix.lower() == ".ply":
        validate_ply(path)
    backend.activate_backend("scalar")
    try:
        mesh = mi.load_dict({"type": MITSUBA_MESHES[path.suffix.lower()], "filename": str(path)})
        faces = mesh.face_count()
        box = mesh.bbox()
    except (RuntimeError, ValueError, TypeError) as error:
        reason = " ".join(str(error).split())
        raise BadInput(f"Mitsuba cannot read the mesh: {reason}", where=str(path)) from error
    if faces == 0:
        raise BadInput("the mesh has no face", where=str(path))
    return np.array([box.min, box.max], dtype=np.float64).reshape(2, 3)
