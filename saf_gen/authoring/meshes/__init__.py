"""Meshes of others, read by trimesh: OBJ with MTL, PLY, STL and glTF 2.0, as shapes of triangles with a matt surface.

trimesh passes over what it does not know, also where that changes what a file shows. So statements and keys are
compared with lists of what is read before trimesh sees a file, and its arrays are checked afterwards.
"""

from pathlib import Path

import numpy as np

from saf_gen.authoring.meshes.gltf import read_gltf
from saf_gen.authoring.meshes.plain import read_obj, read_ply, read_stl
from saf_gen.authoring.meshes.shapes import LeftOut, Shape, Surface, checked, encode_png, srgb_to_linear
from saf_gen.errors import BadInput

__all__ = ["READERS", "LeftOut", "Shape", "Surface", "encode_png", "read_mesh", "srgb_to_linear"]

READERS = {".obj": read_obj, ".ply": read_ply, ".glb": read_gltf, ".gltf": read_gltf, ".stl": read_stl}
"""The reader of each file extension."""


def read_mesh(path: Path, left_out: LeftOut) -> list[Shape]:
    """Return the shapes of a mesh file, in its coordinates; ``left_out`` receives what is left out.

    Raises BadInput if the file is missing, damaged or not supported, or has no face.
    """
    with np.errstate(all="ignore"):  # values that are not finite are refused by name
        shapes = [checked(shape, left_out, path=path) for shape in READERS[path.suffix.lower()](path, left_out)]
    if not shapes:
        raise BadInput("the file has no mesh with a face", where=str(path), hint="; ".join(left_out.lines()))
    return shapes
