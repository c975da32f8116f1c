"""Conversion of mesh files to OBJ files and textures that Mitsuba reads; the only module that imports trimesh."""

import io
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.core.extras import require_extra
from saf_gen.errors import BadInput

CONVERTED_MESHES = (".glb", ".gltf", ".stl")


@dataclass(frozen=True)
class MeshPart:
    """A shape of a scene: its files and its colour."""

    name: str
    files: dict[str, bytes]
    """Content of each file, by name."""
    mesh: str
    """Name of the mesh file."""
    texture: str
    """Name of the file with the base colour; '' if the shape has a single colour."""
    reflectance: tuple[float, ...]
    """Linear red, green and blue, 0 to 1; used if there is no texture."""
    extent: np.ndarray
    """Smallest and largest coordinates, float64 (2, 3), in units of the file."""


def convert_mesh(path: Path) -> list[MeshPart]:
    """Return the meshes of a glTF or STL file, placed as in the scene of the file.

    Parameters
    ----------
    path : Path
        File that ends in .glb, .gltf or .stl.

    Returns
    -------
    list of MeshPart
        One part for each mesh with a face.

    Raises
    ------
    BadInput
        If trimesh is not installed, cannot read the file, or finds no face in it.
    """
    require_extra("mesh", "trimesh", of=f"reading {path.suffix} files")
    import trimesh

    parts: list[MeshPart] = []
    try:
        scene = trimesh.load_scene(path)
        for node in sorted(scene.graph.nodes_geometry):
            transform, name = scene.graph[node]
            mesh = scene.geometry[name]
            if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
                placed = mesh.copy()
                placed.apply_transform(transform)
                parts.append(_convert_part(placed, str(node), taken=[part.name for part in parts]))
    except Exception as error:  # an untrusted file, read by a library that may raise any exception
        reason = " ".join(str(error).split())
        raise BadInput(f"trimesh cannot read the mesh: {type(error).__name__}: {reason}", where=str(path)) from error
    if not parts:
        raise BadInput("the file has no mesh with a face", where=str(path))
    return parts


def _convert_part(mesh: Any, node: str, *, taken: list[str]) -> MeshPart:
    from trimesh.exchange.obj import export_obj

    name = "mesh_" + re.sub(r"\W+", "_", node, flags=re.ASCII).strip("_")  # never the name of a lamp or the wall
    if name in taken:
        name = f"{name}_{len(taken) + 1}"
    lines = export_obj(mesh, include_normals=True, include_color=False, include_texture=True, write_texture=False)
    kept = [line for line in lines.splitlines() if not line.startswith(("#", "mtllib", "usemtl", "o "))]
    files = {f"meshes/{name}.obj": ("\n".join(kept) + "\n").encode()}
    material = getattr(mesh.visual, "material", None)
    picture = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    has_texture = picture is not None and getattr(mesh.visual, "uv", None) is not None
    texture = f"textures/{name}.png" if has_texture else ""
    if picture is not None and texture:
        buffer = io.BytesIO()
        picture.convert("RGB").save(buffer, "PNG")
        files[texture] = buffer.getvalue()
    factor = getattr(material, "baseColorFactor", None)
    colour = (0.6, 0.6, 0.6) if factor is None else tuple(float(c) / 255 for c in np.asarray(factor)[:3])
    return MeshPart(name, files, f"meshes/{name}.obj", texture, colour, np.asarray(mesh.bounds, dtype=np.float64))
