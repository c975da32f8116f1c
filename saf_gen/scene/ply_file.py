"""Checks of untrusted PLY meshes before Mitsuba reads them, because its reader does not check vertex indices."""

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from saf_gen.errors import BadInput

MAX_HEADER_LINES, MAX_LINE_BYTES, MAX_CORNERS = 1_000, 4_096, 1 << 16
MIN_ROWS, MAX_ROWS = 16, 1 << 16
"""Smallest and largest number of rows of an element that are read at once."""
TYPES = {
    **{"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2"},
    **{"uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4"},
    **{"double": "f8", "float64": "f8"},
}
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
CORNERS = ("vertex_index", "vertex_indices")


class Property(NamedTuple):
    """A value, or a list of values, that each row of an element has."""

    name: str
    kind: str
    counted: str
    """Type of the length of a list; "" for a single value."""


class Element(NamedTuple):
    """A table of a PLY file, such as its vertices."""

    name: str
    rows: int
    properties: list[Property]


def is_ply(path: Path) -> bool:
    """Return whether a file begins like a PLY mesh, whatever its name."""
    with path.open("rb") as file:
        return file.read(3) == b"ply"


def validate_ply(path: Path, *, triangles: bool = False) -> None:
    """Raise BadInput unless a PLY file is as long as its header says and all faces name existing vertices.

    If ``triangles`` is true, all faces must be triangles, the only ones that Mitsuba reads from a PLY file.

    References
    ----------
    G. Turk, "The PLY Polygon File Format", Stanford University, 1994.
    """
    try:
        with path.open("rb") as file:
            order, elements = read_header(file)
            vertices = next((element.rows for element in elements if element.name == "vertex"), 0)
            for element in elements:
                for corners in _read_corners(file, element, order=order):
                    if corners.size and not 0 <= (worst := _farthest(corners, vertices)) < vertices:
                        raise ValueError(f"a face names the vertex {worst}, but the number of vertices is {vertices}")
                    if triangles and corners.size and corners.shape[-1] != 3:
                        raise BadInput(
                            f"the mesh has a face of {corners.shape[-1]} corners",
                            where=str(path),
                            allowed="triangles",
                            hint="export it with triangles, or import its scene.xml with saf-gen scenes new --from",
                        )
    except (OSError, ValueError, OverflowError, MemoryError) as error:
        raise BadInput(f"the mesh is damaged: {error}", where=str(path), hint="export it again") from error


def triangulated_ply(path: Path) -> bytes | None:
    """Return a valid PLY mesh with each face split into triangles that share its first corner; None if all are.

    The rows of vertices stay as they are; properties of faces, and elements other than vertices and faces, are left
    out.
    """
    with path.open("rb") as file:
        order, elements = read_header(file)
        rows, triangles, split = b"", [], False
        for element in elements:
            begin = file.tell()
            for corners in _read_corners(file, element, order=order):
                fan = np.atleast_2d(corners).astype(np.int64)
                split |= fan.shape[1] != 3
                for n in range(1, fan.shape[1] - 1):
                    triangles.append(fan[:, [0, n, n + 1]])
            if element.name == "vertex":
                end = file.tell()
                file.seek(begin)
                rows = file.read(end - begin)
    if not split:
        return None
    faces = np.concatenate(triangles) if triangles else np.empty((0, 3), dtype=np.int64)
    vertex = next(element for element in elements if element.name == "vertex")
    names = {np.dtype(kind): name for name, kind in reversed(TYPES.items())}
    form = next(name for name, mark in ORDERS.items() if mark == order)
    header = ["ply", f"format {form} 1.0", f"element vertex {vertex.rows}"]
    for one in vertex.properties:
        kinds = ["list", one.counted, one.kind] if one.counted else [one.kind]
        header.append(f"property {' '.join(names.get(np.dtype(k), k) if k != 'list' else k for k in kinds)} {one.name}")
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    if order == "":
        body = "".join(f"3 {a} {b} {c}\n" for a, b, c in faces.tolist()).encode()
        rows += b"" if rows.endswith(b"\n") else b"\n"
    else:
        packed = np.empty(len(faces), dtype=[("count", "u1"), ("corners", order + "i4", 3)])
        packed["count"], packed["corners"] = 3, faces
        body = packed.tobytes()
    return "\n".join(header).encode() + rows + body


def _farthest(corners: np.ndarray, vertices: int) -> int:
    """Return a corner that is not in 0 <= index < vertices if there is one, else the largest corner."""
    low, high = int(corners.min()), int(corners.max())
    return low if low < 0 else high


def read_header(file: BinaryIO) -> tuple[str, list[Element]]:
    """Return the byte order of a PLY file ("" for text) and its elements, and leave the file at its first row.

    Raises ValueError if the header is damaged.
    """
    order, elements = None, list[Element]()
    for _ in range(MAX_HEADER_LINES):
        line = file.readline(MAX_LINE_BYTES)
        if not line.endswith(b"\n"):
            break
        words = line.decode("ascii", "replace").split()
        match words:
            case ["end_header"] if order is not None:
                if empty := [one for one in elements if one.rows and not one.properties]:
                    raise ValueError(f"its {empty[0].rows:,} rows of {empty[0].name!r:.80} hold nothing")
                return order, elements
            case ["format", name, _] if name in ORDERS:
                order = ORDERS[name]
            case ["element", name, rows] if rows.isdigit():
                elements.append(Element(name, int(rows), []))
            case ["property", "list", count, kind, name] if elements and {count, kind} <= TYPES.keys():
                elements[-1].properties.append(Property(name, TYPES[kind], TYPES[count]))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append(Property(name, TYPES[kind], ""))
            case ["ply"] | ["comment", *_] | ["obj_info", *_]:
                pass
            case _:
                raise ValueError(f"its header has the line {' '.join(words)[:80]!r}")
    raise ValueError("its header has no end")


def _read_corners(file: BinaryIO, element: Element, *, order: str) -> Iterator[np.ndarray]:
    """Read an element to its end and yield its vertex indices, in arrays of any shape."""
    wanted = [n for n, one in enumerate(element.properties) if one.name in CORNERS and element.name == "face"]
    if order == "":
        for _ in range(element.rows):
            words = _line(file).split()
            at = 0
            for n, one in enumerate(element.properties):
                count = 1
                if one.counted:
                    count, at = _checked(int(words[at]) if at < len(words) else -1), at + 1
                if n in wanted:
                    yield np.array([int(word) for word in words[at : at + count]], dtype=np.int64)
                at += count
            if at != len(words):  # Mitsuba would continue to read in the next line
                raise ValueError(f"a {element.name} has {len(words)} numbers on its line instead of {at}")
    elif not any(one.counted for one in element.properties):
        size = sum(np.dtype(one.kind).itemsize for one in element.properties)
        _skip(file, size * element.rows)
    else:
        yield from _read_lists(file, element, order=order, wanted=wanted)


def _read_lists(file: BinaryIO, element: Element, *, order: str, wanted: list[int]) -> Iterator[np.ndarray]:
    """Read the rows of an element that has lists, and yield its vertex indices.

    Rows whose lists have the same lengths are read together; their number doubles as long as the lengths do not change.
    """
    left, at_once = element.rows, MIN_ROWS
    while left:
        at = file.tell()
        lengths = _read_lengths(file, element, order=order)
        fields: list[tuple[str, str, tuple[int, ...]]] = []
        for n, one in enumerate(element.properties):
            if one.counted:
                fields.append((f"count{n}", order + one.counted, ()))
            fields.append((f"value{n}", order + one.kind, (lengths[n],) if one.counted else ()))
        alike = np.dtype(fields)
        file.seek(at)
        raw = file.read(alike.itemsize * min(left, at_once))
        rows = np.frombuffer(raw, alike, len(raw) // alike.itemsize)
        same = np.ones(rows.size, bool)
        for n, one in enumerate(element.properties):
            if one.counted:
                same &= rows[f"count{n}"] == lengths[n]
        kept = rows.size if same.all() else int(same.argmin())
        for n in wanted:
            yield rows[f"value{n}"][:kept]
        file.seek(at + kept * alike.itemsize)
        left -= kept
        at_once = min(2 * at_once, MAX_ROWS) if kept == rows.size else MIN_ROWS


def _read_lengths(file: BinaryIO, element: Element, *, order: str) -> list[int]:
    """Read one row and return the number of values of each property, 1 if it is not a list."""
    lengths = []
    for one in element.properties:
        count = 1
        if one.counted:
            kind = np.dtype(order + one.counted)
            raw = file.read(kind.itemsize)
            if len(raw) < kind.itemsize:
                raise ValueError("it is truncated")
            count = int(np.frombuffer(raw, kind)[0])
        lengths.append(_checked(count))
        _skip(file, lengths[-1] * np.dtype(one.kind).itemsize)
    return lengths


def _checked(count: int) -> int:
    if not 0 <= count <= MAX_CORNERS:
        raise ValueError(f"a list has {count} values")
    return count


def _line(file: BinaryIO) -> bytes:
    line = file.readline(1 << 20)
    if not line.endswith(b"\n") and len(line) == 1 << 20:
        raise ValueError("a line is too long")
    return line


def _skip(file: BinaryIO, count: int) -> None:
    end = file.seek(0, 1) + count
    if end > file.seek(0, 2):
        raise ValueError("it is truncated")
    file.seek(end)
