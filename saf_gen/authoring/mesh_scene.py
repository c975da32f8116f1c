"""A scene around a mesh: the mesh in front of the lens, a lamp, a wall, and a card."""

import io
import re
from collections.abc import Sequence
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


MITSUBA_MESHES = (".obj", ".ply")
UNREADABLE_MESHES = {
    ".blend": "a Blender file",
    ".fbx": "an FBX file",
    ".dae": "a Collada file",
    ".usd": "a USD file",
    ".usdz": "a USD file",
    ".3ds": "a 3ds Max file",
    ".max": "a 3ds Max file",
}
SIZE_M = 0.1
"""Largest side of the mesh in the scene, in metres; at a distance of half a metre, it fills most of the frame."""
CARD = """\
id: NAME
title: TITLE
licence: ""                                  # you decide: an SPDX name, such as CC-BY-4.0; may others use it?
source: SOURCE.md                            # where everything came from

camera:
  origin_m: [0, 0, 0.5]                      # y is up, and the mesh is around the origin
  look_at_m: [0, 0, 0]
  up: [0, 1, 0]

lens:
  drive: image_distance
  focal_length_mm: 25
  f_number: 2.0
  focus_range_m: [0.65, 0.40]                # in focus at position 0 and at 1

lights:                                      # lamps that are switched together
  lamp: [lamp]
  room: [room]

target: [TARGET]                             # shapes that should be in focus
"""
SOURCE = """\
# NAME

Made from FILE by `saf-gen scenes new --from`, scaled by SCALE, with lamp and wall from a template that is free to use.
State here who made the mesh and its textures, where they are from, their licence, and what was changed.
"""
SURROUNDINGS = """\
	<!-- The background: wider than the field of view, because blur brings in what is just outside -->
	<shape type="rectangle" id="wall">
		<transform name="to_world"><scale value="0.5"/><translate z="-0.2"/></transform>
		<bsdf type="diffuse"><rgb name="reflectance" value="0.3 0.3 0.3"/></bsdf>
	</shape>

	<!-- A shape that emits light, and light from all directions -->
	<shape type="rectangle" id="lamp">
		<transform name="to_world">
			<scale value="0.08"/>
			<lookat origin="0.3, 0.3, 0.6" target="0, 0, 0" up="0, 1, 0"/>
		</transform>
		<emitter type="area"><rgb name="radiance" value="60 60 60"/></emitter>
	</shape>
	<emitter type="constant" id="room"><rgb name="radiance" value="0.5 0.5 0.5"/></emitter>
</scene>
"""


def is_mesh(path: Path) -> bool:
    """Return whether the file is a mesh around which a scene can be made.

    Raises BadInput for a file format of another program, with a hint on how to convert it.
    """
    suffix = path.suffix.lower()
    if suffix in UNREADABLE_MESHES:
        raise BadInput(
            f"{path} is {UNREADABLE_MESHES[suffix]}, which saf_gen cannot read",
            allowed=f"a scene.xml, or a mesh: {', '.join((*MITSUBA_MESHES, *CONVERTED_MESHES))}",
            hint="in Blender, use File > Export > Mitsuba (.xml) of the add-on mitsuba-blender for the scene with its"
            " lamps, or glTF 2.0 (.glb) for the mesh",
        )
    return suffix in (*MITSUBA_MESHES, *CONVERTED_MESHES)


def scene_of_mesh(path: Path, name: str) -> dict[str, bytes]:
    """Return the content of the files of a scene around a mesh, by file name.

    The mesh is scaled so that its largest side is SIZE_M, and centred at the origin, 0.5 m in front of the lens. All
    its shapes form the target.

    Parameters
    ----------
    path : Path
        Mesh file.
    name : str
        Name of the scene.

    Returns
    -------
    dict of str to bytes

    Raises
    ------
    BadInput
        If the file is missing or cannot be read, or if the mesh has no size.
    """
    if not path.is_file():
        raise BadInput(f"{path} cannot be read: there is no such file")
    parts = _read_parts(path)
    extent = np.array([np.min([p.extent[0] for p in parts], axis=0), np.max([p.extent[1] for p in parts], axis=0)])
    side = float((extent[1] - extent[0]).max())
    if not (np.isfinite(extent).all() and side > 0):
        raise BadInput("the mesh has no size", where=str(path), allowed="finite coordinates that differ")
    scale, middle = SIZE_M / side, extent.mean(axis=0)
    shapes = "\n".join(_format_shape(part, scale=scale, middle=middle) for part in parts)
    texts = {
        "scene.xml": f'<scene version="3.0.0">\n{shapes}\n{SURROUNDINGS}',
        "scene.yaml": CARD.replace("TARGET", ", ".join(part.name for part in parts))
        .replace("TITLE", f"{name.replace('_', ' ').capitalize()}, in front of a wall")
        .replace("NAME", name),
        "SOURCE.md": SOURCE.replace("NAME", name).replace("FILE", path.name).replace("SCALE", f"{scale:.4g}"),
    }
    files = {file: data for part in parts for file, data in part.files.items()}
    return files | {file: text.encode() for file, text in texts.items()}


def _read_parts(path: Path) -> Sequence[MeshPart]:
    if path.suffix.lower() in CONVERTED_MESHES:
        return convert_mesh(path)
    from saf_gen.render.mitsuba_scene import mesh_extent  # loads Mitsuba

    file = f"meshes/mesh{path.suffix.lower()}"
    return [MeshPart("mesh", {file: path.read_bytes()}, file, "", (0.6, 0.6, 0.6), mesh_extent(path))]


def _format_shape(part: MeshPart, *, scale: float, middle: np.ndarray) -> str:
    x, y, z = (f"{-value:.9g}" for value in middle)
    colour = " ".join(f"{c:.4g}" for c in part.reflectance)
    surface = (
        f'<texture type="bitmap" name="reflectance"><string name="filename" value="{part.texture}"/></texture>'
        if part.texture
        else f'<rgb name="reflectance" value="{colour}"/>'
    )
    return f"""\
	<shape type="{part.mesh.rpartition(".")[2]}" id="{part.name}">
		<string name="filename" value="{part.mesh}"/>
		<transform name="to_world"><translate x="{x}" y="{y}" z="{z}"/><scale value="{scale:.9g}"/></transform>
		<bsdf type="twosided"><bsdf type="diffuse">{surface}</bsdf></bsdf>
	</shape>
"""
