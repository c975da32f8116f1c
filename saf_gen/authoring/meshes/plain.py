"""OBJ with MTL, PLY and STL files, whose statements are compared with a list before trimesh reads them.

References
----------
Alias|Wavefront, "Advanced Visualizer Manual", appendices B1 (object files) and B2 (material files), 1995. Colours of
vertices, which it does not have, follow the coordinates, and are sRGB-coded as Blender writes and reads them, as are
those of PLY. Kd and Ke are linear, as in Blender; pictures are sRGB-coded.
"""

import io
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain, pairwise
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from saf_gen.authoring.meshes.shapes import (
    GREY,
    HUGE,
    MAX_CORNERS,
    MAX_SHAPES,
    LeftOut,
    Pictures,
    Shape,
    Surface,
    as_array,
    load,
    optional,
    read_beside,
    read_bytes,
    srgb_to_linear,
    uv_of,
)
from saf_gen.errors import BadInput
from saf_gen.scene.ply_file import CORNERS, read_header, validate_ply

COMMENT = re.compile(r"(^|\s)#.*")  # a name may hold the sign
CORNER = re.compile(r"(-?\d+)(?:/(-?\d*)(?:/(-?\d+))?)?")
COUNTS = {"v": (3, 6), "vt": (2, 3), "vn": (3,)}
"""Number of values of each statement; the last three of a vertex are its colour."""
KINDS = {"v": "vertex", "vt": "texture coordinate", "vn": "normal"}
OBJ_KEYS = (*COUNTS, "f", "usemtl", "mtllib", "o", "g", "s", "l", "p")
MTL_KEYS = ("kd", "map_kd", "ke", "d", "tr")
MTL_SILENT = ("ka", "ns", "ni", "illum", "map_ka")
MTL_IGNORED = (
    *("ks", "map_ks", "map_ns", "bump", "map_bump", "norm", "map_kn", "disp", "map_disp", "refl", "map_refl", "tf"),
    *("pr", "map_pr", "pm", "map_pm", "ps", "map_ps", "pc", "pcr", "aniso", "anisor"),
)
"""Statements of gloss, relief and layers, which are left out."""


class _Corner(NamedTuple):
    """Indices from 1 that a corner of a face names, 0 for none, their text, and whether the last two are there."""

    indices: list[int]
    text: str
    form: tuple[bool, bool]


@dataclass
class _Faces:
    """Faces of one material as triangles, in lines for trimesh, and their numbers of corners."""

    lines: list[str] = field(default_factory=list)
    sides: list[int] = field(default_factory=list)


def read_obj(path: Path, left_out: LeftOut) -> list[Shape]:
    """Return the shapes of an OBJ file: one or more for each material that a face uses, named after it.

    trimesh gets vertices and triangles alone, in groups, with comments, continued lines and negative indices resolved.
    """
    from trimesh.exchange.obj import load_obj  # trimesh loads in half a second

    rows: list[str] = []
    sizes, widths = dict.fromkeys(COUNTS, 0), dict[str, int]()
    known: dict[str, _Corner] = {}
    faces: dict[tuple[str, tuple[bool, bool]], _Faces] = {}  # corners of one material may have several forms
    library = material = ""
    for line, key, words in _lines(read_bytes(path), path):
        try:
            if key in COUNTS:
                if widths.setdefault(key, len(words)) != len(words) or len(words) not in COUNTS[key]:
                    allowed = " or ".join(map(str, COUNTS[key]))
                    raise ValueError(f"{key} has {len(words)} numbers; allowed: {allowed}, as many in each line")
                values = [float(word) for word in words]
                if not all(map(math.isfinite, values)):
                    raise ValueError(f"{key} has a value that is not a finite number")
                if key == "v" and not all(0 <= value <= 1 for value in values[3:]):
                    raise ValueError("v has a colour that is not from 0 to 1")
                rows.append(f"{key} {' '.join(map(repr, values))}")
                sizes[key] += 1
            elif key == "f":
                corners = [known.get(word) or _corner(word, sizes) for word in words]
                known.update((word, corner) for word, corner in zip(words, corners, strict=True) if "-" not in word)
                if len(corners) < 3:
                    raise ValueError(f"a face has {len(corners)} corners; allowed: 3 or more")
                if len({corner.form for corner in corners}) > 1:
                    raise ValueError("a corner of a face lacks the texture coordinates or the normal of another")
                group = faces.setdefault((material, corners[0].form), _Faces())
                first, *others = [corner.text for corner in corners]
                group.lines += [f"f {first} {b} {c}" for b, c in pairwise(others)]
                group.sides.append(len(corners))
            elif key == "usemtl":
                material = " ".join(words)
            elif key == "mtllib":
                if library and " ".join(words) != library:
                    raise ValueError("a second mtllib; allowed: one material library")
                library = " ".join(words)
            elif key in ("l", "p"):
                left_out.add("points and lines ignored")
            elif key not in OBJ_KEYS:
                raise ValueError(f"{key[:40]!r} is not read; allowed: {', '.join(OBJ_KEYS)}")
        except ValueError as error:
            raise BadInput(str(error), where=f"{path}:{line}", hint="export it again, or as glTF 2.0 (.glb)") from error
    for k, (key, size) in enumerate(sizes.items()):
        if (largest := max((corner.indices[k] for corner in known.values()), default=0)) > size:
            problem = f"the mesh is damaged: a face names the {KINDS[key]} {largest}, and the file has {size}"
            raise BadInput(problem, where=str(path), hint="export it again")
    if len(faces) > MAX_SHAPES or 3 * sum(len(group.lines) for group in faces.values()) > MAX_CORNERS:
        allowed = f"up to {MAX_SHAPES:,} materials and {MAX_CORNERS:,} corners"
        raise BadInput("the mesh is too large", where=str(path), allowed=allowed, hint="reduce it")
    if not faces:
        return []
    looks = _looks(library, dict.fromkeys(name for name, _ in faces if name), path=path, left_out=left_out)
    text = "\n".join([*rows, *chain.from_iterable([f"g {n}", *g.lines] for n, g in enumerate(faces.values()))])
    loaded = load(load_obj, text.encode(), path=path, skip_materials=True, group_material=False, split_groups=True)
    shapes = []
    for n, ((name, form), group) in enumerate(faces.items()):
        mesh = loaded["geometry"][str(n)]
        colours, normals = optional(mesh.get("vertex_colors")), optional(mesh.get("vertex_normals"))
        shape = Shape(
            name,
            as_array(mesh["vertices"]),
            as_array(mesh["faces"], np.int64),
            looks.get(name, Surface(GREY if colours is None else (1.0, 1.0, 1.0))),
            normals=normals,
            uv=uv_of(mesh["visual"]),
            colours=colours if colours is None else srgb_to_linear(colours),
        )
        if (shape.uv is not None, normals is not None) != form:
            raise BadInput(f"the values of the corners of {name!r} cannot be read", where=str(path))
        _refuse_bent_fans(shape, np.array(group.sides), path=path)
        shapes.append(shape)
    return shapes


def _lines(data: bytes, path: Path) -> Iterator[tuple[int, str, list[str]]]:
    """Yield the number, keyword and other words of each line of a file; a backslash continues a line."""
    if b"\0" in data:  # also in UTF-16, between the letters
        raise BadInput("this is not text in UTF-8 or ASCII", where=str(path), hint="save it as UTF-8")
    pending, first = "", 0
    for number, raw in enumerate(data.removeprefix(b"\xef\xbb\xbf").splitlines(), 1):
        text = raw.decode("utf-8", "replace").rstrip()
        text = COMMENT.sub("", text).rstrip() if "#" in text else text
        first = first if pending else number
        pending += text.removesuffix("\\") + " "
        if not text.endswith("\\"):
            words = pending.split()
            pending = ""
            if words:
                yield first, words[0], words[1:]


def _corner(word: str, sizes: Mapping[str, int]) -> _Corner:
    """Return what a corner such as 3/1/2 or -1//-1 names, after so many values of each kind."""
    match = CORNER.fullmatch(word)
    if match is None:
        raise ValueError(f"a face has the corner {word[:40]!r}")
    indices = []
    for part, (key, size) in zip(match.groups(), sizes.items(), strict=True):
        index = int(part) if part else 0
        if part and (index == 0 or index < -size):
            raise ValueError(f"a face names the {KINDS[key]} {index}, and the file has {size} before it")
        indices.append(index + size + 1 if index < 0 else index)
    text = "/".join(str(index or "") for index in indices).rstrip("/")
    return _Corner(indices, text, (indices[1] > 0, indices[2] > 0))


def _refuse_bent_fans(shape: Shape, sides: np.ndarray, *, path: Path) -> None:
    """Raise BadInput if the triangles round the first corner of a face do not all turn the same way."""
    a, b, c = (shape.points[shape.triangles[:, k]] for k in range(3))
    turns, first = np.cross(b - a, c - a), np.concatenate([[0], np.cumsum(sides - 2)[:-1]])
    sizes = np.linalg.norm(turns, axis=1)
    face, whole = (np.repeat(np.add.reduceat(values, first), sides - 2, axis=0) for values in (turns, sizes))
    bent = ((turns * face).sum(axis=1) < 1e-6 * sizes * whole) & (sizes > 1e-9 * whole)
    if bent.any():
        corners = sides[int(np.searchsorted(first, bent.argmax(), side="right")) - 1]
        raise BadInput(
            f"a face of {corners} corners is not convex",
            where=str(path),
            allowed="triangles, and convex faces",
            hint="export it with triangles",
        )


def _looks(library: str, used: Iterable[str], *, path: Path, left_out: LeftOut) -> dict[str, Surface]:
    """Return the surfaces of the materials in use, by name."""
    entries: dict[str, dict[str, list[str]]] = {}
    entry: dict[str, list[str]] = {}
    data = read_beside(library, path, what="material library") if library and used else b""
    for _, key, words in _lines(data, path.parent / library):
        if key.lower() == "newmtl":
            entry = entries.setdefault(" ".join(words), {})
        else:
            entry[key.lower()] = words
    pictures, folder = Pictures(path), PurePosixPath(library.replace("\\", "/")).parent
    looks = {}
    for name in used:
        if name in entries:
            looks[name] = _look(name, entries[name], left_out=left_out, pictures=pictures, folder=folder)
        else:
            why = "its mtllib does not have them" if library else "the file names no mtllib"
            left_out.add(f"materials are grey, because {why}", name)
    return looks


def _look(
    name: str, entry: dict[str, list[str]], *, left_out: LeftOut, pictures: Pictures, folder: PurePosixPath
) -> Surface:
    """Return the surface of a material: Kd × map_Kd, d, and Ke."""

    def refusal(problem: str, allowed: str) -> BadInput:
        hint = "correct its .mtl file, or export it as glTF 2.0 (.glb)"
        where = str(pictures.mesh)
        return BadInput(f"the material {name!r} has {problem[:80]!r}", where=where, allowed=allowed, hint=hint)

    def numbers(key: str, default: float, count: int, most: float = HUGE) -> list[float]:
        words = entry.get(key, [str(default)])
        try:
            values = [float(word) for word in words]
            if len(values) not in (1, count) or not all(0 <= value <= most for value in values):
                raise ValueError
        except ValueError:
            raise refusal(f"{key} {' '.join(words)}", f"{count} from 0 to {most:g}") from None
        return values if len(values) == count else values * count

    for key, words in entry.items():
        if key not in (*MTL_KEYS, *MTL_SILENT, *MTL_IGNORED):
            raise refusal(" ".join([key, *words]), ", ".join([*MTL_KEYS, *MTL_SILENT, *MTL_IGNORED]))
        if key in MTL_IGNORED and set(" ".join(words)) - set("0. "):
            left_out.add(f"{key} ignored", name)
    file = entry.get("map_kd", [])
    if file and file[0].startswith("-"):
        raise refusal(" ".join(["map_Kd", *file]), "a file name without options")
    pixels = None
    if file:
        pixels = pictures.named(str(folder / " ".join(file)))
        pixels = np.dstack([pixels[..., :3], np.full_like(pixels[..., 0], 255)])  # its opacity does not count
    (opacity,) = numbers("d", 1 - numbers("tr", 0, 1, 1)[0], 1, 1)
    red, green, blue = numbers("kd", GREY[0] if pixels is None else 1, 3, 1)
    glow = numbers("ke", 0, 3)
    return Surface(
        (red, green, blue),
        pixels,
        opacity=opacity,
        alpha="blend" if opacity < 1 else "opaque",
        emission=(glow[0], glow[1], glow[2]),
    )


# PLY and STL

CODED = ("red", "green", "blue", "alpha")
PLY_KEYS = (*CODED, *"xyzstuv", "nx", "ny", "nz", "texture_u", "texture_v", "texcoord", *CORNERS)
STL_WORDS = {"solid": None, "facet": 5, "outer": 2, "vertex": 4, "endloop": 1, "endfacet": 1, "endsolid": None}
"""Number of words on each line of a text STL file."""
STL_HEADER, STL_FACET = 84, 50


def read_ply(path: Path, left_out: LeftOut) -> list[Shape]:
    """Return the triangles of a PLY file as one shape without a name."""
    from trimesh.exchange.ply import load_ply

    data = read_bytes(path)
    validate_ply(path, triangles=True)
    stream = io.BytesIO(data)
    header = read_header(stream)[1]
    elements = {element.name: element for element in header}

    def refusal(problem: str, allowed: str) -> BadInput:
        return BadInput(problem, where=str(path), allowed=allowed, hint="export it as glTF 2.0 (.glb), or without it")

    for name, element in elements.items():
        if element.rows and name not in ("vertex", "face"):
            raise refusal(f"the mesh has {element.rows:,} rows of {name!r:.80}", "vertex, face")
    names = [[element.name for element in header], *([one.name for one in e.properties] for e in header)]
    if any(len(set(group)) < len(group) for group in names):
        raise refusal("the header has two elements or properties of one name", "one")
    if "vertex" not in elements or "face" not in elements or not elements["face"].rows:
        return []
    if 3 * elements["face"].rows > MAX_CORNERS:
        raise refusal("the mesh is too large", f"up to {MAX_CORNERS:,} corners")
    kinds = {one.name: one.kind for one in elements["vertex"].properties if not one.counted}
    of_faces = [one.name for one in elements["face"].properties]
    if not {"x", "y", "z"} <= kinds.keys():
        raise refusal(f"the vertices have {', '.join(kinds)}", "x, y, z and others")
    if not {*CORNERS} & {*of_faces}:
        raise refusal(f"the faces have {', '.join(of_faces)}", " or ".join(CORNERS))
    if {*CODED} & {*of_faces}:
        raise refusal("the faces have colours", "colours of vertices")
    if any(kinds.get(name, "u1") != "u1" for name in CODED) or len({*CODED[:3]} & kinds.keys()) in (1, 2):
        raise refusal("the colours of the vertices are not red, green and blue in bytes", "uchar red, green, blue")
    for name in (*kinds, *of_faces):
        if name not in PLY_KEYS:
            left_out.add("properties ignored", name)
    lines = [line.strip() for line in data[: stream.tell()].splitlines()]
    textures = [line for line in lines if line.startswith(b"comment TextureFile ")]
    if len(textures) > 1:
        raise refusal(f"the mesh has {len(textures)} textures", "one")
    # trimesh takes the second line for that of the format, and knows words of the header also in a comment.
    kept = [line for line in lines if line.split()[:1] not in ([b"comment"], [b"obj_info"])]
    mesh = load(load_ply, b"\n".join([*kept, data[stream.tell() :]]), path=path, fix_texture="texcoord" in of_faces)
    colours, normals = optional(mesh.get("vertex_colors")), optional(mesh.get("vertex_normals"))
    if "texcoord" in of_faces and (colours is not None or normals is not None):
        left_out.add("normals and colours ignored beside texture coordinates of faces")
        colours = normals = None
    if colours is not None and colours.shape[1] == 4 and (colours[:, 3] < 255).any():
        left_out.add("opacity of vertices ignored")
    picture = None
    if textures:
        picture = Pictures(path).named(textures[0].decode("utf-8", "replace").split(maxsplit=2)[2])
    shape = Shape(
        "",
        as_array(mesh["vertices"]),
        as_array(mesh["faces"], np.int64).reshape(-1, 3),
        Surface(GREY if colours is None and picture is None else (1.0, 1.0, 1.0), picture),
        normals=normals,
        uv=uv_of(mesh.get("visual")),
        colours=None if colours is None else srgb_to_linear(colours[:, :3] / 255),
    )
    return [shape]


def read_stl(path: Path, left_out: LeftOut) -> list[Shape]:
    """Return the triangles of an STL file, binary or text, as one shape without a name."""
    from trimesh.exchange.stl import load_stl

    data = read_bytes(path)
    binary = len(data) >= STL_HEADER and len(data) == STL_HEADER + STL_FACET * int.from_bytes(data[80:84], "little")
    if not binary:
        data = _stl_text(data, path)
    loaded = load(load_stl, data, path=path)
    if "vertices" not in loaded:
        return []
    points, attributes = as_array(loaded["vertices"]), loaded.get("face_attributes", {}).get("stl")
    if len(points) > MAX_CORNERS:
        raise BadInput("the mesh is too large", where=str(path), allowed=f"up to {MAX_CORNERS // 3:,} triangles")
    if attributes is not None and (attributes.any() or b"COLOR=" in data[:80]):
        left_out.add("colours of facets ignored")
    return [Shape("", points, as_array(loaded["faces"], np.int64), flat=True)]


def _stl_text(data: bytes, path: Path) -> bytes:
    """Return the facets of a text STL file without names, as one solid."""
    lines = [line.split() for line in data.decode("utf-8", "replace").lower().splitlines() if line.strip()]
    try:
        if not lines or lines[0][0] != "solid":
            raise ValueError(f"{len(data):,} bytes are neither text nor the number of facets that it states")
        for words in lines:
            if words[0] not in STL_WORDS or STL_WORDS[words[0]] not in (None, len(words)):
                raise ValueError(f"it has the line {' '.join(words)[:40]!r}")
        first = [words[0] for words in lines]
        vertices, facets = first.count("vertex"), first.count("endfacet")
        if first[-1] != "endsolid" or vertices != 3 * facets:
            raise ValueError(f"it has {vertices} vertices and {facets} complete facets")
        rows = [[float(word) for word in words[1:]] for words in lines if words[0] == "vertex"]
    except ValueError as error:
        hint = "export or download it again"
        raise BadInput(f"the mesh is damaged: {error}", where=str(path), hint=hint) from error
    body = "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in rows)
    return f"solid\n{body}endsolid\n".encode()
