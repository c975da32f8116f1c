"""Shapes of a Wavefront OBJ file and the materials of its MTL files; one shape for each material.

References
----------
Alias|Wavefront, "Advanced Visualizer Manual", appendices B1 (object files) and B2 (material files), 1995. Colours of
vertices, which it does not have, follow the coordinates, and are sRGB-coded as Blender writes and reads them. Kd and Ke
are linear, as in Blender; pictures are sRGB-coded.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

import numpy as np
from PIL import Image

from saf_gen.authoring.meshes.shapes import (
    GREY,
    MAX_CORNERS,
    MAX_SHAPES,
    LeftOut,
    Shape,
    Surface,
    checked,
    srgb_to_linear,
    triangulate,
)
from saf_gen.authoring.meshes.side_files import Pictures, find_side_file, read_bytes
from saf_gen.errors import BadInput

COMMENT = re.compile(r"(^|\s)#.*")  # a name may hold the sign
FREE_FORM = ("curv", "curv2", "surf", "cstype")
HARMLESS = ("o", "g", "s", "mg", "vp", "lod", "bevel", "c_interp", "d_interp", "usemap", "maplib", "shadow_obj")


@dataclass
class _Faces:
    """Corners of the faces of one material: vertex, texture coordinate and normal of each, -1 if it has none."""

    corners: list[tuple[int, int, int]] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)


def read_obj(path: Path, left_out: LeftOut) -> list[Shape]:
    """Return the shapes of an OBJ file, in its coordinates.

    Parameters
    ----------
    path : Path
        A file that ends in .obj.
    left_out : LeftOut
        Receives what is left out.

    Returns
    -------
    list of Shape
        One for each material that a face uses; the first one has an empty name if the file uses no material.

    Raises
    ------
    BadInput
        If the file is damaged, or names a file that is missing or outside its folder.
    """
    points: list[list[float]] = []
    uv: list[list[float]] = []
    normals: list[list[float]] = []
    faces: dict[str, _Faces] = {}
    libraries: dict[str, None] = {}
    material = ""
    at = 0
    try:
        for line, key, words in _lines(path):
            at = line
            match key:
                case "v":
                    points.append([float(word) for word in words])
                case "vt":
                    uv.append([float(word) for word in [words[0], *words[1:], "0"][:2]])
                case "vn":
                    normals.append([float(word) for word in words[:3]])
                case "f" | "fo":
                    found = faces.setdefault(material, _Faces())
                    sizes = len(points), len(uv), len(normals)
                    found.corners += [_corner(word, sizes) for word in words]
                    found.counts.append(len(words))
                case "usemtl":
                    material = " ".join(words)
                case "mtllib":
                    libraries[" ".join(words)] = None
                case "l" | "p":
                    left_out.add("points and lines ignored")
                case _ if key in FREE_FORM:
                    left_out.add("free-form curves and surfaces ignored")
                case _ if key == "call" or key == "csh":
                    raise ValueError(f"{key} is refused")
                case _ if key not in HARMLESS:
                    left_out.add("lines ignored", key)
    except (ValueError, IndexError) as error:
        raise BadInput(f"the mesh is damaged: {error}", where=f"{path}:{at}", hint="export it again") from error
    if len(faces) > MAX_SHAPES or sum(len(f.corners) for f in faces.values()) > MAX_CORNERS:
        allowed = f"up to {MAX_SHAPES:,} materials and {MAX_CORNERS:,} corners"
        raise BadInput("the mesh is too large", where=str(path), allowed=allowed, hint="reduce it")
    looks = _looks(path, [name for name in faces if name], libraries=list(libraries), left_out=left_out)
    vertices = _Vertices(path, points, uv=uv, normals=normals, left_out=left_out)
    shapes = [vertices.shape(name, found, look=looks.get(name)) for name, found in faces.items()]
    return [checked(shape, left_out, path=path) for shape in shapes if shape.triangles.size]


def _lines(path: Path) -> Iterator[tuple[int, str, list[str]]]:
    """Yield the number, keyword and other words of each line; a backslash continues a line."""
    pending, first = "", 0
    for number, raw in enumerate(read_bytes(path).removeprefix(b"\xef\xbb\xbf").splitlines(), 1):
        text = raw.decode("utf-8", "replace").rstrip()
        text = COMMENT.sub("", text).rstrip() if "#" in text else text
        first = first if pending else number
        pending += text.removesuffix("\\") + " "
        if not text.endswith("\\"):
            words = pending.split()
            pending = ""
            if words:
                yield first, words[0], words[1:]


def _corner(word: str, sizes: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return the indices, from 0, that a corner such as 3/1/2 or -1//-1 names."""
    parts = word.split("/")
    if len(parts) > 3 or not parts[0]:
        raise ValueError(f"a face has the corner {word[:40]!r}")
    found = [-1, -1, -1]
    for n, part in enumerate(parts):
        if part:
            index = int(part)
            found[n] = index - 1 if index > 0 else sizes[n] + index
            if index == 0 or not 0 <= found[n] < (sizes[n] if index < 0 else 1 << 31):
                what = ("vertex", "texture coordinate", "normal")[n]
                raise ValueError(f"a face names the {what} {index}, and the file has {sizes[n]} before it")
    return found[0], found[1], found[2]


class _Vertices:
    """The vertices, texture coordinates and normals of a file."""

    def __init__(
        self,
        path: Path,
        points: list[list[float]],
        *,
        uv: list[list[float]],
        normals: list[list[float]],
        left_out: LeftOut,
    ) -> None:
        self.path, self.left_out = path, left_out
        if any(len(point) < 3 for point in points) or any(len(normal) < 3 for normal in normals):
            raise BadInput("the mesh is damaged: a vertex has fewer than 3 numbers", where=str(path))
        self.points = np.array([point[:3] for point in points], dtype=np.float64).reshape(-1, 3)
        self.uv = np.array(uv, dtype=np.float64).reshape(-1, 2)
        self.normals = np.array(normals, dtype=np.float64).reshape(-1, 3)
        self.colours = self._read_colours(points)

    def _read_colours(self, points: list[list[float]]) -> np.ndarray | None:
        if not any(len(point) >= 6 for point in points):
            return None
        coded = np.array([[*point[3:6], 1] if len(point) >= 6 else [1, 1, 1, 1] for point in points], dtype=np.float64)
        if np.isfinite(coded).all() and (coded.min() < 0 or coded.max() > 1):
            self.left_out.add("vertex colours ignored, they are not from 0 to 1")
            return None
        return np.column_stack([srgb_to_linear(coded[:, :3]), coded[:, 3]])

    def shape(self, name: str, faces: _Faces, *, look: "_Look | None") -> Shape:
        """Return the shape of a material's faces; without a look, it is grey or has the colours of its vertices."""
        corners, counts = np.array(faces.corners, dtype=np.int64).reshape(-1, 3), np.array(faces.counts, dtype=np.int64)
        for n, (what, there) in enumerate(
            (("vertex", self.points), ("texture coordinate", self.uv), ("normal", self.normals))
        ):
            if corners.size and corners[:, n].max() >= len(there):
                last = corners[:, n].max() + 1
                raise BadInput(
                    f"the mesh is damaged: a face names the {what} {last}, and the file has {len(there)}",
                    where=str(self.path),
                    hint="export it again",
                )
        if (counts < 3).any():
            self.left_out.add("faces with fewer than 3 corners ignored", name)
        split, _ = triangulate(self.points[corners[:, 0]], counts, path=self.path)
        at, at_uv, at_normal, triangles = _unique_corners(corners[split.ravel()])
        has_uv, has_normals = bool((at_uv >= 0).any()), bool(at.size and (at_normal >= 0).all())
        if not has_normals and (at_normal >= 0).any():
            self.left_out.add("normals ignored, some corners have none", name)
        colours = None if self.colours is None else self.colours[at]
        look = look or _Look(Surface(GREY if colours is None else (1.0, 1.0, 1.0)))
        surface, uv = look.surface, self.uv * look.scale + look.offset
        if surface.picture is not None or surface.emission_picture is not None:
            if not has_uv:
                raise BadInput(
                    f"the faces of {name!r} have a texture and no texture coordinates",
                    where=str(self.path),
                    hint="export it again with texture coordinates (UV)",
                )
            if (at_uv < 0).any():
                self.left_out.add("faces without texture coordinates show a corner of the texture", name)
        return Shape(
            name,
            self.points[at],
            triangles.reshape(-1, 3),
            surface,
            normals=self.normals[at_normal] if has_normals else None,
            uv=np.where(at_uv[:, None] >= 0, uv[at_uv] * [1, -1] + [0, 1], 0.0) if has_uv else None,  # v pointed up
            colours=colours,
        )


def _unique_corners(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the columns of the different rows (row, 3) in order, and the number of each row among these."""
    at, at_uv, at_normal = corners.T + 1
    _, pair = np.unique(at * (at_uv.max(initial=0) + 1) + at_uv, return_inverse=True)
    _, first, found = np.unique(
        pair * (at_normal.max(initial=0) + 1) + at_normal, return_index=True, return_inverse=True
    )
    return corners[first, 0], corners[first, 1], corners[first, 2], found


@dataclass(frozen=True)
class _Look:
    """A surface, and what its maps do to texture coordinates: uv · scale + offset."""

    surface: Surface
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)


def _looks(path: Path, used: list[str], *, libraries: list[str], left_out: LeftOut) -> dict[str, _Look]:
    """Return the looks of the materials in use, by name."""
    found: dict[str, _Mtl] = {}
    pictures = Pictures(path)
    for names in libraries if used else ():
        for library, file in _library_files(path, names):
            folder = PurePosixPath(library.replace("\\", "/")).parent
            for name, entry in _materials(file).items():  # the first library that has a material counts
                found.setdefault(name, _Mtl(path, name, entry, folder, pictures, left_out))
    looks = {}
    for name in used:
        if name in found:
            looks[name] = found[name].look()
        else:
            why = "no mtllib has them" if libraries else "the file names no mtllib"
            left_out.add(f"materials are grey, because {why}", name)
    return looks


def _library_files(path: Path, names: str) -> list[tuple[str, Path]]:
    """Return the names and files of a mtllib line: one whose name may have spaces, or several."""
    try:
        return [(names, find_side_file(names, path, what="material library"))]
    except BadInput:
        if " " not in names:
            raise
        return [(name, find_side_file(name, path, what="material library")) for name in names.split()]


def _materials(file: Path) -> dict[str, dict[str, list[str]]]:
    """Return the words of each statement, by its keyword in lower case, of each material of an MTL file."""
    materials: dict[str, dict[str, list[str]]] = {}
    current: dict[str, list[str]] = {}
    for _, key, words in _lines(file):
        if key.lower() == "newmtl":
            current = materials.setdefault(" ".join(words), {})
        else:
            current[key.lower()] = words
    return materials


MAPS = {
    "map_ks": "specular map",
    "map_ns": "gloss map",
    "map_ka": "ambient map",
    "bump": "bump map",
    "map_bump": "bump map",
    "norm": "normal map",
    "map_kn": "normal map",
    "disp": "displacement",
    "map_disp": "displacement",
    "refl": "reflection map",
    "map_refl": "reflection map",
    "decal": "decal",
    "map_pr": "roughness map",
    "map_pm": "metallic map",
    "map_ps": "sheen map",
    "map_tr": "transparency map",
}
"""Maps that are left out."""
OPTIONS = dict.fromkeys(("-blendu", "-blendv", "-bm", "-boost", "-cc", "-clamp", "-imfchan", "-texres", "-type"), 1) | {
    "-mm": 2,
    "-o": 3,
    "-s": 3,
    "-t": 3,
}
"""Number of values of each option of a map; the last three have one to three."""
KEPT_OPTIONS = ("-blendu", "-blendv", "-clamp", "-imfchan", "-o", "-s")
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
ONE = (1.0, 1.0, 1.0)
NONE = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class _Map:
    """A picture's name and options."""

    name: str
    options: dict[str, list[str]]

    @property
    def placement(self) -> tuple[tuple[float, float], tuple[float, float], bool]:
        """Scale and offset of texture coordinates, and whether the edge of the picture is continued."""
        scale = [float(word) for word in self.options.get("-s", [])] + [1.0, 1.0]
        offset = [float(word) for word in self.options.get("-o", [])] + [0.0, 0.0]
        return (scale[0], scale[1]), (offset[0], offset[1]), self.options.get("-clamp") == ["on"]


@dataclass(frozen=True)
class _Mtl:
    """A material of an MTL file."""

    path: Path
    name: str
    entry: dict[str, list[str]]
    folder: PurePosixPath
    """Folder of the MTL file as the mesh names it; pictures are named from there."""
    pictures: Pictures
    left_out: LeftOut

    def look(self) -> _Look:
        """Return the look with Kd × map_Kd, d × map_d and Ke × map_Ke; say what else the material has."""
        self._say_what_is_ignored()
        maps = {key: self._map(key) for key in ("map_kd", "map_d", "map_ke")}
        placed = {m.placement for m in maps.values() if m is not None} or {((1.0, 1.0), (0.0, 0.0), False)}
        if len(placed) > 1:
            raise self._refusal("its maps have different options -o, -s or -clamp")
        ((scale, offset, clamped),) = placed
        picture = self._picture(maps["map_kd"])
        colour = self._numbers("kd", GREY if picture is None else ONE)
        if picture is not None and not any(colour):
            self.left_out.add("textures are black, because Kd is 0 0 0", self.name)
        if max(colour) > 1:
            self.left_out.add("Kd above 1 is taken as 1", self.name)
        opacity = self._opacity()
        clear = opacity < 1 or maps["map_d"] is not None
        if clear:
            picture = self._with_opacity(picture, maps["map_d"])
        glow = self._picture(maps["map_ke"])
        emission = self._numbers("ke", NONE if glow is None else ONE)
        red, green, blue = (min(max(c, 0.0), 1.0) for c in colour)
        surface = Surface(
            colour=(red, green, blue),
            picture=picture,
            opacity=opacity,
            alpha="blend" if clear else "opaque",
            emission=emission,
            emission_picture=glow if any(emission) else None,
            wrap="clamp" if clamped else "repeat",
        )
        return _Look(surface, scale, offset)

    def _say_what_is_ignored(self) -> None:
        for key, what in MAPS.items():
            if key in self.entry:
                self.left_out.add(f"{what} ignored", self.name)
        for key, what in (
            ("ks", "specular reflection"),
            ("pm", "metallic"),
            ("pc", "clearcoat"),
            ("ps", "sheen"),
            ("aniso", "anisotropy"),
        ):
            if any(self._numbers(key, NONE)):
                self.left_out.add(f"{what} ignored", self.name)
        if any(share < 1 for share in self._numbers("tf", ONE)):
            self.left_out.add("transmission ignored", self.name)

    def _refusal(self, problem: str) -> BadInput:
        return BadInput(
            f"the material {self.name!r}: {problem}", where=str(self.path), hint="correct it in the .mtl file"
        )

    def _numbers(self, key: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
        """Return three numbers of a statement; one number stands for all three."""
        words = self.entry.get(key)
        if words is None:
            return default
        if words[:1] in (["spectral"], ["xyz"]):
            self.left_out.add(f"{key} in {words[0]} ignored", self.name)
            return default
        try:
            numbers = [float(word) for word in words[:3]]
            if not np.isfinite(numbers).all() or len(numbers) not in (1, 3):
                raise ValueError
        except ValueError as error:
            raise self._refusal(f"{key} is {' '.join(words)!r}; allowed: three numbers") from error
        red, green, blue = numbers * 3 if len(numbers) == 1 else numbers
        return red, green, blue

    def _opacity(self) -> float:
        """Return d, or 1 - Tr, from 0 to 1."""
        words = self.entry.get("d", [])
        if words[:1] == ["-halo"]:
            self.left_out.add("halo ignored", self.name)
            words = words[1:]
        try:
            opacity = float(words[0]) if words else 1 - float(self.entry.get("tr", ["0"])[0])
        except (ValueError, IndexError) as error:
            raise self._refusal(f"d or Tr is {' '.join(words or self.entry['tr'])!r}; allowed: 0 to 1") from error
        if not 0 <= opacity <= 1:
            raise self._refusal(f"its opacity is {opacity}; allowed: 0 to 1")
        return opacity

    def _map(self, key: str) -> _Map | None:
        """Return the picture that a statement names, and its options."""
        words = list(self.entry.get(key, []))
        options: dict[str, list[str]] = {}
        while words and words[0].lower() in OPTIONS:
            option = words.pop(0).lower()
            least = 1 if option in ("-o", "-s", "-t") else OPTIONS[option]
            values = words[:least]
            del words[:least]
            while len(values) < OPTIONS[option] and len(words) > 1 and NUMBER.fullmatch(words[0]):
                values.append(words.pop(0))
            options[option] = values
            if option not in KEPT_OPTIONS:
                self.left_out.add(f"{option} of {key} ignored", self.name)
        if not words:
            return None
        found = _Map(" ".join(words), options)
        try:
            if not np.isfinite(found.placement[0] + found.placement[1]).all():
                raise ValueError
        except (ValueError, TypeError) as error:
            raise self._refusal(f"{key} has -o or -s that are no numbers") from error
        return found

    def _picture(self, named: _Map | None) -> np.ndarray | None:
        if named is None:
            return None
        return self.pictures.named(str(self.folder / named.name))

    def _with_opacity(self, picture: np.ndarray | None, named: _Map | None) -> np.ndarray | None:
        """Return the picture with the values of map_d as its opacity: its alpha if it has any, else its brightness."""
        mask = self._picture(named)
        if mask is None or named is None:  # the alpha of map_Kd does not count
            return None if picture is None else np.dstack([picture[..., :3], np.full_like(picture[..., 0], 255)])
        channel = (named.options.get("-imfchan") or ["m" if mask[..., 3].min() < 255 else "l"])[0]
        if channel in ("r", "g", "b", "m"):
            values = mask[..., "rgbm".index(channel)]
        else:
            values = np.asarray(Image.fromarray(mask).convert("RGB").convert("L"))
        if picture is None:
            picture = np.full((*values.shape, 4), 255, np.uint8)
        elif picture.shape[:2] != values.shape:
            rows, columns = picture.shape[:2]
            values = np.asarray(Image.fromarray(values).resize((columns, rows), Image.Resampling.BILINEAR))
        return np.dstack([picture[..., :3], values])
