"""Mesh files: OBJ, PLY, STL and glTF 2.0, read into shapes of triangles with a matt surface."""

from pathlib import Path

import numpy as np

from saf_gen.authoring.meshes.gltf import read_gltf
from saf_gen.authoring.meshes.obj import read_obj
from saf_gen.authoring.meshes.ply import read_ply
from saf_gen.authoring.meshes.shapes import LeftOut, Shape, Surface, srgb_to_linear
from saf_gen.authoring.meshes.stl import read_stl
from saf_gen.errors import BadInput

__all__ = ["READERS", "LeftOut", "Shape", "Surface", "read_mesh", "srgb_to_linear"]

READERS = {".obj": read_obj, ".ply": read_ply, ".glb": read_gltf, ".gltf": read_gltf, ".stl": read_stl}
"""The reader of each file extension."""


def read_mesh(path: Path, left_out: LeftOut) -> list[Shape]:
    """Return the shapes of a mesh file, in its coordinates; ``left_out`` receives what is left out.

    Raises BadInput if the file is missing, damaged or not supported, or has no face.
    """
    with np.errstate(all="ignore"):  # values that are not finite are refused by name
        shapes = [shape for shape in READERS[path.suffix.lower()](path, left_out) if len(shape.triangles)]
    if not shapes:
        raise BadInput("the file has no mesh with a face", where=str(path), hint="; ".join(left_out.lines()))
    return shapes
