"""The one door to Mitsuba's meshes, whose normals it makes the same on any number of threads.

Mitsuba adds up the normals of the faces around each vertex by float atomics, in the order in which threads come. Here
Dr.Jit computes what each face adds, and one loop adds it, in the order of one thread of eight lanes: exactly what
Mitsuba itself computes on one thread of a processor with AVX2, but for faces of nearly no area. Mitsuba takes the sum
as if a file had held it.

The areas of a mesh lamp's faces, by which points on it are drawn, are added by Mitsuba. On LLVM it does so in pieces of
a fixed length, equal on any number of threads. On a card the last digits of these sums vary from run to run, and there
is no way to hand them over.

Scripts of others may call Mitsuba's meshes themselves.

Mitsuba 3.10 renames what is used here: ``positions``, ``normals`` and ``texcoords`` are tensors, ``mi.Mesh(name,
faces=, positions=, normals=)`` builds a mesh in one call, and ``flip_normals`` is baked into the order of corners.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.core.compiled import compiled
from saf_gen.errors import BadInput
from saf_gen.scene.ply_file import read_header

POSITIONS, NORMALS, FACES, UV = "vertex_positions", "vertex_normals", "faces", "vertex_texcoords"
OBJ_NORMAL = re.compile(rb"^[ \t\r]*vn[ \t]", re.MULTILINE)
LANES = 8
"""Faces that are added together: the width of AVX2."""
SCALE = 64.0
"""Enlarges meshes while their normals are computed, because threads of Dr.Jit take what is smaller than SMALLEST as 0,
and Python's own thread, which is the only one if there is one, does not."""
SMALLEST = float(np.finfo(np.float32).smallest_normal)


def vertex_normals(positions: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the normals of a mesh's vertices, each the mean of the faces around it, weighted by their angles there.

    The weights are those of Thürmer and Wüthrich ("Computing vertex normals from polygonal facets", J. Graphics Tools
    3, 1998), which Mitsuba uses, too.

    Parameters
    ----------
    positions : ndarray of float32, shape (vertex, 3)
        Vertices.
    faces : ndarray of uint32, shape (face, 3)
        Indices of the vertices of each triangle.

    Returns
    -------
    ndarray of float32, shape (vertex, 3)
        Normals of length 1; (1, 0, 0) for a vertex of no face with an area. A face has none if twice its area is below
        1e-19 square units, as at the poles of a ball whose corners are rounded.
    """
    flat: Any = mi.Float(np.float32(SCALE) * np.ravel(positions).astype(np.float32))
    at: list[Any] = [mi.UInt32(np.ascontiguousarray(faces[:, corner])) for corner in range(3)]
    corners = [mi.Vector3f(*(dr.gather(mi.Float, flat, 3 * index + axis) for axis in range(3))) for index in at]
    normal = dr.cross(corners[1] - corners[0], corners[2] - corners[0])
    area = dr.squared_norm(normal)
    # The root of what is smaller is infinite without the scale: Mitsuba's own threads make black poles of balls so.
    area = dr.select(area < SMALLEST * SCALE**4, 0, area)
    normal = normal * dr.rsqrt(area)
    weighted = np.empty((3, len(faces), 3), dtype=np.float32)
    for n, corner in enumerate(corners):
        sides = [dr.normalize(corners[(n + k) % 3] - corner) for k in (1, 2)]
        angle = dr.safe_acos(dr.dot(*sides))
        weighted[n] = dr.select(area > 0, normal * angle, 0).numpy().T
    weighted[np.abs(weighted) < SMALLEST] = 0
    total: Any = mi.Vector3f(_add_up(weighted, np.ascontiguousarray(faces, dtype=np.uint32), len(positions)).T)
    length = dr.squared_norm(total)
    return dr.select(length > 0, total * dr.rsqrt(length), mi.Vector3f(1, 0, 0)).numpy().T


@compiled
def _add_up(weighted, faces, vertices):
    """Add what corners give to their vertices, float32 (vertex, 3): by packets of faces, then corners, then lanes.

    Faces of a packet that share a vertex at the same corner are added first, as a tree of lanes. A face without an area
    has no angle, nan, where two of its corners coincide; it counts only beside others of its packet.
    """
    total = np.zeros((vertices, 3), np.float32)
    lanes = np.empty(LANES, np.float32)
    for first in range(0, len(faces), LANES):
        stop = min(first + LANES, len(faces))
        for corner in range(3):
            for face in range(first, stop):
                vertex, seen = faces[face, corner], False
                for other in range(first, face):
                    seen |= faces[other, corner] == vertex
                if seen:
                    continue
                for axis in range(3):
                    lanes[:] = 0
                    counts = False
                    for other in range(face, stop):
                        if faces[other, corner] == vertex:
                            value = weighted[corner, other, axis]
                            lanes[other - first] = value
                            counts |= value < 0 or value > 0
                    if counts:
                        even = (lanes[0] + lanes[4]) + (lanes[2] + lanes[6])
                        total[vertex, axis] += even + ((lanes[1] + lanes[5]) + (lanes[3] + lanes[7]))
    return total


def has_vertices(shape: Any) -> bool:
    """Return whether a shape is a mesh with vertices; an ``mi.Mesh`` made from a rectangle has none."""
    return isinstance(shape, mi.Mesh) and POSITIONS in mi.traverse(shape)


def has_own_attributes(shape: Any) -> bool:
    """Return whether vertices or faces of a shape carry more than their geometry, which textures may show."""
    return bool(_own_attributes(mi.traverse(shape)))


def _own_attributes(held: Any) -> list[str]:
    names = {key for key in held.keys() if key.startswith(("vertex_", "face_"))}  # noqa: SIM118
    return sorted(names - {POSITIONS, NORMALS, UV})


def black_triangles(held: Any) -> int:
    """Return the number of triangles of some size whose normals have no length, in a traversed shape."""
    if NORMALS not in held:  # a rectangle
        return 0
    normals, points = (np.array(held[key]).reshape(-1, 3) for key in (NORMALS, POSITIONS))
    dark = ~(np.abs(normals) > 1e-6).any(axis=1)
    if not dark.any():
        return 0
    faces = np.array(held[FACES]).reshape(-1, 3)
    a, b, c = (points[faces[dark[faces].all(axis=1), k]] for k in range(3))
    return int((np.cross(b - a, c - a) != 0).any(axis=1).sum())


def make_mesh(
    name: str,
    positions: np.ndarray,
    *,
    faces: np.ndarray,
    bsdf: Any,
    uv: np.ndarray | None = None,
    normals: np.ndarray | None = None,
    smooth: bool = False,
    attributes: Mapping[str, np.ndarray] | None = None,
    **properties: Any,
) -> Any:
    """Return a Mitsuba mesh whose id is its name; scripts of scenes may import this function.

    Parameters
    ----------
    name : str
        Id of the mesh.
    positions : ndarray, shape (vertex, 3)
        Vertices, in units of the scene.
    faces : ndarray, shape (face, 3)
        Indices of the vertices of each triangle.
    bsdf : dict or BSDF
        Surface; a loaded one may be shared by several meshes.
    uv : ndarray, optional
        Texture coordinates, (vertex, 2).
    normals : ndarray, optional
        Normals of the vertices, (vertex, 3), for which a mesh is smooth.
    smooth : bool, default False
        Give a mesh without them the normals of :func:`vertex_normals`.
    attributes : mapping of str to ndarray, optional
        Values of vertices or faces that textures show, float32, by names that begin with ``vertex_`` or ``face_``.
    **properties : object
        More properties of the shape, as Mitsuba names them.

    Raises
    ------
    BadInput
        If a smooth mesh has a face with a vertex that does not exist.
    """
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(bsdf) if isinstance(bsdf, dict) else bsdf
    for key, value in properties.items():
        props[key] = value
    counts = {"vertex": np.size(positions) // 3, "face": np.size(faces) // 3}
    flags = {"has_vertex_normals": smooth or normals is not None, "has_vertex_texcoords": uv is not None}
    made = mi.Mesh(name, counts["vertex"], counts["face"], props=props, **flags)
    made.set_id(name)
    held = mi.traverse(made)
    for key, array in {POSITIONS: positions, UV: uv, FACES: faces, NORMALS: normals}.items():
        if array is not None:
            held[key] = type(held[key])(np.ascontiguousarray(array).ravel())
    if smooth and normals is None and not _is_scalar():
        _set_normals(held, "", name=name)
    held.update()
    for key, array in (attributes or {}).items():
        values: Any = np.ravel(array).astype(np.float32)
        made.add_attribute(key, values.size // counts[key.split("_")[0]], values)
    return made


def move_mesh(mesh: Any, pose: np.ndarray) -> Any:
    """Return a moved copy of a mesh, with the same faces, surface and attributes; ``pose`` is float64 (4, 4)."""
    source = mi.traverse(mesh)
    properties = {
        "interior": mesh.interior_medium(),
        "exterior": mesh.exterior_medium(),
        "face_normals": mesh.has_face_normals(),
        "flip_normals": mesh.has_flipped_normals(),
    }
    turn = pose[:3, :3].T
    rows = {
        key: np.array(source[key], dtype=np.float64).reshape(-1, 3) for key in (POSITIONS, NORMALS) if key in source
    }
    return make_mesh(
        mesh.id(),
        rows[POSITIONS] @ turn + pose[:3, 3],
        faces=np.array(source[FACES]),
        bsdf=mesh.bsdf(),
        uv=np.array(source[UV]) if mesh.has_vertex_texcoords() else None,
        normals=rows[NORMALS] @ turn if mesh.has_vertex_normals() else None,
        attributes={key: np.array(source[key]) for key in _own_attributes(source)},
        **{key: value for key, value in properties.items() if value is not None},
    )


@contextmanager
def normals_in_order() -> Iterator[None]:
    """Let meshes that a scene's script makes, or reads from files, have their normals from :func:`vertex_normals`.

    The script calls Mitsuba itself. Meshes whose normals it gives keep them.
    """
    if _is_scalar():
        yield
        return
    mesh, update, load = mi.Mesh, mi.Mesh.parameters_changed, mi.load_dict

    def hand_over(made: Any, keys: Any = ()) -> None:
        if _would_compute_normals(made, keys):
            _set_normals(mi.traverse(made), "", name=made.id())
            keys = [*(keys or mi.traverse(made).keys()), NORMALS]
        update(made, list(keys))

    def load_settled(entry: Any, *arguments: Any, **options: Any) -> Any:
        made = load(entry, *arguments, **options)
        settle_files(made, entry)
        return made

    recompute = mesh.recompute_vertex_normals
    patched: dict[str, Callable[..., Any]] = {
        "parameters_changed": hand_over,
        "recompute_vertex_normals": lambda made: hand_over(made, [POSITIONS]),
    }
    try:
        for name, function in patched.items():
            setattr(mesh, name, function)
        mi.load_dict = load_settled  # type: ignore[assignment]
        yield
    finally:
        del mesh.parameters_changed  # which it has from mi.Object
        mesh.recompute_vertex_normals = recompute  # type: ignore[method-assign]
        mi.load_dict = load


def _is_scalar() -> bool:
    """Return whether Mitsuba has no threads, and so adds in one order itself."""
    return "scalar" in str(mi.variant())


def _would_compute_normals(mesh: Any, keys: Any) -> bool:
    """Return whether Mitsuba would compute normals after these parameters of a mesh were set; none stand for all."""
    if not mesh.has_vertex_normals() or NORMALS in keys:
        return False
    held = mi.traverse(mesh)
    counts = len(held[POSITIONS]) // 3, len(held[FACES]) // 3
    return not keys or POSITIONS in keys or counts != (mesh.vertex_count(), mesh.face_count())


def settle_files(loaded: Any, described: Any) -> None:
    """Replace the normals that Mitsuba computed for mesh files without normals; ``described`` is what was loaded."""
    if _is_scalar():
        return
    if prefixes := list(_files_without_normals({"": described}, "")):
        held = mi.traverse(loaded)
        for prefix in prefixes:
            if f"{prefix}{NORMALS}" in held:
                _set_normals(held, prefix, name=prefix.rstrip("."))


def _files_without_normals(entries: Mapping[str, Any], prefix: str) -> Iterator[str]:
    """Yield what the parameters of each mesh file that holds no normals begin with."""
    for key, entry in entries.items():
        if not isinstance(entry, Mapping):
            continue
        at = f"{prefix}{entry.get('id', key)}." if key else ""
        if entry.get("type") in ("scene", "shapegroup"):
            yield from _files_without_normals(entry, at)
        elif entry.get("type") in ("ply", "obj") and not (entry.get("face_normals") or _has_normals(entry)):
            yield at


def _has_normals(entry: Mapping[str, Any]) -> bool:
    path = Path(str(mi.file_resolver().resolve(str(entry["filename"]))))  # type: ignore[operator]
    if entry["type"] == "obj":
        return OBJ_NORMAL.search(path.read_bytes()) is not None
    with path.open("rb") as file:
        _, elements = read_header(file)
    return any({"nx", "ny", "nz"} <= {p.name for p in e.properties} for e in elements if e.name == "vertex")


def _set_normals(held: Any, prefix: str, *, name: str) -> None:
    """Compute the normals of a mesh among parameters. Raises BadInput if a face names a vertex that does not exist."""
    positions = np.array(held[f"{prefix}{POSITIONS}"], dtype=np.float32).reshape(-1, 3)
    faces = np.array(held[f"{prefix}{FACES}"], dtype=np.uint32).reshape(-1, 3)
    if faces.size and faces.max() >= len(positions):
        what = f"the mesh {name!r}" if name else "a mesh"
        raise BadInput(f"{what} has a face with the vertex {faces.max()}", allowed=f"0 to {len(positions) - 1}")
    held[f"{prefix}{NORMALS}"] = mi.Float(vertex_normals(positions, faces).ravel())
