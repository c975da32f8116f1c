"""Polygons of a PLY file, text or binary of either byte order, with the colours of its vertices or faces.

References
----------
G. Turk, "The PLY Polygon File Format", Stanford University, 1994. It leaves the coding of colours open; they are
sRGB-coded, as Blender and three.js write and read them, except for Mitsuba's ``r``, ``g`` and ``b``, which are linear.
"""

import io
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from saf_gen.authoring.meshes.shapes import (
    GREY,
    MAX_CORNERS,
    LeftOut,
    Shape,
    Surface,
    checked,
    srgb_to_linear,
    triangulate,
)
from saf_gen.authoring.meshes.side_files import Pictures, read_bytes
from saf_gen.errors import BadInput
from saf_gen.scene.ply_file import CORNERS, Element, read_header, validate_ply

UV_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
NORMAL_NAMES = ("nx", "ny", "nz")
CODED_COLOURS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
LINEAR_COLOURS = ("r", "g", "b")


@dataclass(frozen=True)
class Lists:
    """The lists of a property: the values of all rows one after another, and the number of values of each row."""

    values: np.ndarray
    counts: np.ndarray


Columns = dict[str, np.ndarray | Lists]


def read_ply(path: Path, left_out: LeftOut) -> list[Shape]:
    """Return the polygons of a PLY file, in its coordinates, as one shape without a name.

    Parameters
    ----------
    path : Path
        A file that ends in .ply.
    left_out : LeftOut
        Receives what is left out.

    Returns
    -------
    list of Shape
        Empty if the file has no face.

    Raises
    ------
    BadInput
        If the file is damaged.
    """
    data = read_bytes(path)
    validate_ply(path)
    elements = _read_elements(data, path)
    for name in elements:
        if name not in ("vertex", "face"):
            left_out.add("elements ignored", name)
    vertex, face = elements.get("vertex", {}), elements.get("face", {})
    lists = next((face[name] for name in CORNERS if name in face), None)
    if not isinstance(lists, Lists) or not lists.values.size:
        return []
    if len(lists.values) > MAX_CORNERS:
        raise BadInput("the mesh is too large", where=str(path), allowed=f"up to {MAX_CORNERS:,} corners")
    points = _columns(vertex, ("x", "y", "z"))
    if points is None:
        raise BadInput("the mesh is damaged: its vertices lack x, y or z", where=str(path), hint="export it again")
    at = lists.values.astype(np.int64)
    if (lists.counts < 3).any():
        left_out.add("faces with fewer than 3 corners ignored")
    split, polygons = triangulate(points[at], lists.counts.astype(np.int64), path=path)
    colours = _colours(vertex, left_out)
    uv = next((c for c in (_columns(vertex, names) for names in UV_NAMES) if c is not None), None)
    wedges, face_colours = face.get("texcoord"), _colours(face, left_out)
    normals = _columns(vertex, NORMAL_NAMES)
    picture = _picture(data, path)
    corners = at[split]
    of_corners = face_colours is not None and colours is None
    has_wedges = isinstance(wedges, Lists) and bool((wedges.counts == 2 * lists.counts).all())
    if face_colours is not None and colours is not None:
        left_out.add("colours of faces ignored, its vertices have colours")
    if of_corners or has_wedges:  # each corner becomes a vertex
        points, corners = points[corners.ravel()], np.arange(corners.size).reshape(-1, 3)
        normals, colours = (None if a is None else a[at[split].ravel()] for a in (normals, colours))
        if face_colours is not None and colours is None:
            colours = np.repeat(face_colours[polygons], 3, axis=0)
        if has_wedges and isinstance(wedges, Lists):
            uv = wedges.values.reshape(-1, 2)[split.ravel()].astype(np.float64)
        elif uv is not None:
            uv = uv[at[split].ravel()]
    if picture is not None and uv is None:
        raise BadInput(
            "the mesh has a texture and no texture coordinates", where=str(path), hint="export it again with them"
        )
    uv = None if uv is None else uv * [1, -1] + [0, 1]  # v points up in the file
    has_colour = picture is not None or colours is not None
    clear = colours is not None and bool((colours[:, 3] < 1).any())
    surface = Surface((1.0, 1.0, 1.0) if has_colour else GREY, picture, alpha="blend" if clear else "opaque")
    return [checked(Shape("", points, corners, surface, normals, uv, colours), left_out, path=path)]


def _columns(element: Columns, names: tuple[str, ...]) -> np.ndarray | None:
    """Return properties of an element side by side, float64, or None if one is missing."""
    found = [values for name in names if isinstance(values := element.get(name), np.ndarray)]
    return np.column_stack(found).astype(np.float64) if len(found) == len(names) else None


def _colours(element: Columns, left_out: LeftOut) -> np.ndarray | None:
    """Return the linear colours and the opacity of an element, float64 (row, 4), or None if it has none."""
    for names in (*CODED_COLOURS, LINEAR_COLOURS):
        coded = _columns(element, names)
        if coded is None:
            continue
        kind = np.asarray(element[names[0]]).dtype
        alpha = element.get(names[0].replace("red", "alpha")) if names[0] != "r" else None
        opacity = np.ones(len(coded)) if not isinstance(alpha, np.ndarray) else alpha / _full(alpha.dtype)
        coded = np.column_stack([coded / _full(kind), opacity])
        if np.isfinite(coded).all() and coded.size and (coded.min() < 0 or coded.max() > 1):
            left_out.add("colours ignored, they are not from 0 to 1")
            return None
        return coded if names == LINEAR_COLOURS else np.column_stack([srgb_to_linear(coded[:, :3]), coded[:, 3]])
    return None


def _full(kind: np.dtype) -> int:
    """Return the number that stands for 1: the largest integer of a type, or 1."""
    return int(np.iinfo(kind).max) if kind.kind in "iu" else 1


def _picture(data: bytes, path: Path) -> np.ndarray | None:
    """Return the texture that a comment ``TextureFile NAME`` names, as MeshLab writes it, or None."""
    header = data[: data.index(b"end_header")].decode("utf-8", "replace")
    names = re.findall(r"^comment TextureFile (.+?)\s*$", header, re.MULTILINE)
    if len(names) > 1:
        raise BadInput(
            f"the mesh has {len(names)} textures", where=str(path), allowed="one", hint="export it as glTF 2.0 (.glb)"
        )
    if not names:
        return None
    return Pictures(path).named(names[0])


def _read_elements(data: bytes, path: Path) -> dict[str, Columns]:
    """Return the columns of each element of a file that :func:`validate_ply` accepts."""
    stream = io.BytesIO(data)
    order, elements = read_header(stream)
    try:
        read = _text_rows if order == "" else _binary_rows
        return {element.name: read(stream, element, order=order) for element in elements}
    except (ValueError, IndexError, OverflowError) as error:
        raise BadInput(f"the mesh is damaged: {error}", where=str(path), hint="export it again") from error


def _text_rows(stream: io.BytesIO, element: Element, *, order: str) -> Columns:
    rows = [stream.readline().split() for _ in range(element.rows)]
    columns: Columns = {}
    if not any(one.counted for one in element.properties):
        table = np.array(rows, dtype=np.float64).reshape(element.rows, len(element.properties))
        return {one.name: table[:, n].astype(one.kind) for n, one in enumerate(element.properties)}
    at = [0] * element.rows
    for one in element.properties:
        if one.counted:
            counts = [int(row[k]) for row, k in zip(rows, at, strict=True)]
            values = [v for row, k, n in zip(rows, at, counts, strict=True) for v in row[k + 1 : k + 1 + n]]
            columns[one.name] = Lists(np.array(values, np.float64).astype(one.kind), np.array(counts, np.int64))
            at = [k + 1 + n for k, n in zip(at, counts, strict=True)]
        else:
            columns[one.name] = np.array([row[k] for row, k in zip(rows, at, strict=True)], np.float64).astype(one.kind)
            at = [k + 1 for k in at]
    return columns


def _binary_rows(stream: io.BytesIO, element: Element, *, order: str) -> Columns:
    """Read rows together if their lists have the same lengths as those of the first row, else one by one."""
    data, start, at = stream.getbuffer(), stream.tell(), stream.tell()
    lengths = []
    for one in element.properties if element.rows else ():
        count = 1
        if one.counted:
            count = int(np.frombuffer(data, order + one.counted, 1, at)[0])
            at += np.dtype(one.counted).itemsize
        lengths.append(count)
        at += count * np.dtype(one.kind).itemsize
    alike = _row_type(element, lengths or [0] * len(element.properties), order=order)
    if start + alike.itemsize * element.rows <= len(data):
        rows = np.frombuffer(data, alike, element.rows, start)
        if all((rows[f"count{n}"] == lengths[n]).all() for n, one in enumerate(element.properties) if one.counted):
            stream.seek(start + alike.itemsize * element.rows)
            return {
                one.name: Lists(rows[f"value{n}"].ravel(), np.full(element.rows, lengths[n] if lengths else 0))
                if one.counted
                else rows[f"value{n}"]
                for n, one in enumerate(element.properties)
            }
    columns, end = _uneven_rows(data, start, element=element, order=order)
    stream.seek(end)
    return columns


def _row_type(element: Element, lengths: list[int], *, order: str) -> np.dtype:
    fields: list[tuple[str, str] | tuple[str, str, tuple[int, ...]]] = []
    for n, one in enumerate(element.properties):
        if one.counted:
            fields += [(f"count{n}", order + one.counted), (f"value{n}", order + one.kind, (lengths[n],))]
        else:
            fields.append((f"value{n}", order + one.kind))
    return np.dtype(fields)


def _uneven_rows(data: memoryview, at: int, *, element: Element, order: str) -> tuple[Columns, int]:
    """Return the columns of rows with lists of different lengths, and where they end."""
    raw: list[list[bytes]] = [[] for _ in element.properties]
    counts: list[list[int]] = [[] for _ in element.properties]
    sizes = [
        (np.dtype(one.counted).itemsize if one.counted else 0, np.dtype(one.kind).itemsize)
        for one in element.properties
    ]
    bytes_order: Literal["big", "little"] = "big" if order == ">" else "little"
    for _ in range(element.rows):
        for n, (head, size) in enumerate(sizes):
            count = int.from_bytes(data[at : at + head], bytes_order) if head else 1
            at += head
            raw[n].append(bytes(data[at : at + count * size]))
            counts[n].append(count)
            at += count * size
    columns: Columns = {}
    for n, one in enumerate(element.properties):
        values = np.frombuffer(b"".join(raw[n]), order + one.kind)
        columns[one.name] = Lists(values, np.array(counts[n], np.int64)) if one.counted else values
    return columns, at
