"""What a mesh file holds: shapes of triangles with their surfaces, what was left out, and the files that it names."""

import io
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np
from PIL import Image, UnidentifiedImageError

from saf_gen.core.config.document import check_plain_file
from saf_gen.errors import BadInput, closest, escape_controls

GREY = (0.6, 0.6, 0.6)
"""Reflectance of a surface for which a file states no colour."""
MAX_BYTES, MAX_SHAPES, MAX_CORNERS = 1 << 29, 1_000, 30_000_000
MAX_PIXELS = 1 << 27
"""Of all pictures of a mesh together: eight of 4096 × 4096."""
HUGE = 1e30
"""Limit of all numbers: single precision, in which Mitsuba computes, ends at 3·10³⁸."""
NAMED = 6  # shapes that a line names; the others are counted
PICTURE_FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "TGA", "BMP", "GIF")
PICTURE_MODES = ("1", "L", "LA", "P", "RGB", "RGBA")


@dataclass(frozen=True)
class Surface:
    """The matt colour, opacity and emission of a surface.

    Attributes
    ----------
    colour : tuple of float
        Linear red, green and blue, 0 to 1; a factor of the picture and of the colours of vertices.
    picture : ndarray or None
        sRGB-coded colours and opacity, uint8 (rows, columns, 4). Its first row is at v = 0.
    opacity : float
        Factor of the opacity of the picture.
    alpha : {'opaque', 'mask', 'blend'}
        Whether opacity is ignored, compared with the cutoff, or used.
    cutoff : float
        Smallest opacity of what is shown by 'mask'.
    emission : tuple of float
        Radiance of its own light in red, green and blue, in W m⁻² sr⁻¹; a factor of the emission's picture.
    emission_picture : ndarray or None
        sRGB-coded colours, uint8 (rows, columns, 4).
    wrap : {'repeat', 'mirror', 'clamp'}
        What is shown outside the picture.
    smooth : bool
        Whether colours between texels are interpolated.
    roughness, metallic : float
        Roughness, whose square is the α of the gloss, and the share of metal, 0 to 1; factors of the gloss's picture.
    gloss_picture : ndarray or None
        Roughness in green and metal in blue, uint8 (rows, columns, 4).
    index : float
        Refractive index, from which the gloss of what is not metal follows.
    """

    colour: tuple[float, float, float] = GREY
    picture: np.ndarray | None = None
    opacity: float = 1.0
    alpha: Literal["opaque", "mask", "blend"] = "opaque"
    cutoff: float = 0.5
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    emission_picture: np.ndarray | None = None
    wrap: Literal["repeat", "mirror", "clamp"] = "repeat"
    smooth: bool = True
    roughness: float = 1.0
    metallic: float = 0.0
    gloss_picture: np.ndarray | None = None
    index: float = 1.5


@dataclass(frozen=True)
class Shape:
    """Triangles with one surface.

    Attributes
    ----------
    name : str
        Name in the file.
    points : ndarray
        Coordinates of the vertices, float64 (vertex, 3), in units of the file.
    triangles : ndarray
        Vertices of each triangle, counter-clockwise seen from outside, int64 (triangle, 3).
    surface : Surface
        The surface.
    normals : ndarray or None
        Normals of the vertices, float64 (vertex, 3).
    uv : ndarray or None
        Texture coordinates, float64 (vertex, 2); v points down in the picture.
    colours : ndarray or None
        Linear colours of the vertices, float64 (vertex, 3).
    flat : bool
        Whether triangles are shaded as planes; otherwise, missing normals are interpolated.
    node : str
        Name of the node that places it.
    """

    name: str
    points: np.ndarray
    triangles: np.ndarray
    surface: Surface = field(default_factory=Surface)
    normals: np.ndarray | None = None
    uv: np.ndarray | None = None
    colours: np.ndarray | None = None
    flat: bool = False
    node: str = ""


class LeftOut:
    """What a reader leaves out of a file, as lines for the user: each kind once, with the names of its shapes."""

    def __init__(self) -> None:
        self._names: dict[str, dict[str, None]] = {}

    def add(self, kind: str, name: str = "") -> None:
        """Add a kind, such as "clearcoat ignored", and the name of the shape or material that has it."""
        self._names.setdefault(kind, {}).update({name: None} if name else {})

    def lines(self) -> list[str]:
        """Return a line for each kind."""
        named = ((kind, f": {_listed(list(names))}" if names else "") for kind, names in self._names.items())
        return [escape_controls(kind + shapes) for kind, shapes in named]


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(" ".join(name[:80].split()) for name in names[:NAMED]) + more


def checked(shape: Shape, left_out: LeftOut, *, path: Path) -> Shape:
    """Return a shape with finite values, existing vertices that its triangles use, and usable normals."""

    def refusal(problem: str) -> BadInput:
        return BadInput(problem, where=str(path), hint="export it again")

    of = f" of {shape.name!r}" if shape.name else ""
    count = len(shape.points)
    columns = {
        "coordinate": (shape.points, 3),
        "normal": (shape.normals, 3),
        "texture coordinate": (shape.uv, 2),
        "colour": (shape.colours, 3),
    }
    for what, (array, width) in columns.items():
        if array is not None and array.shape != (count, width):
            raise refusal(f"{len(array)} {what}s{of} do not fit {count} vertices")
        if array is not None and not (np.abs(array) < HUGE).all():
            raise refusal(f"a {what}{of} is not a finite number")
    low, high = int(shape.triangles.min()), int(shape.triangles.max())
    if low < 0 or high >= count:
        raise refusal(f"a face{of} names the vertex {low if low < 0 else high}, but the number of vertices is {count}")
    if not all(0 <= radiance < HUGE for radiance in shape.surface.emission):
        stated = " ".join(f"{radiance:.6g}" for radiance in shape.surface.emission)
        raise BadInput(f"the emission{of} is {stated}", where=str(path), allowed="0 or more", hint="correct it")
    if any(shape.surface.emission) and shape.surface.alpha != "opaque":
        raise BadInput(f"the surface{of} emits light and is not opaque", where=str(path), hint="make it one of them")
    surface = shape.surface
    pictured = any(one is not None for one in (surface.picture, surface.emission_picture, surface.gloss_picture))
    if pictured and shape.uv is None:
        raise refusal(f"the faces{of} have a texture and no texture coordinates")
    used, triangles = np.unique(shape.triangles, return_inverse=True)
    normals, uv, colours = (None if a is None else a[used] for a in (shape.normals, shape.uv, shape.colours))
    triangles = triangles.reshape(-1, 3)
    shape = replace(shape, points=shape.points[used], triangles=triangles, normals=normals, uv=uv, colours=colours)
    if shape.normals is not None:
        length = np.linalg.norm(shape.normals, axis=1, keepdims=True)
        if (length < 1e-12).any():
            left_out.add("normals ignored, some have no length", shape.name)
            return replace(shape, normals=None)
        return replace(shape, normals=shape.normals / length)
    return shape


def load(reader: Callable[..., dict[str, Any]], data: bytes, *, path: Path, **how: Any) -> dict[str, Any]:
    """Return what one of trimesh's readers returns for the content of a file; raise BadInput if it fails."""
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", "string or file could not be read to its end")  # numpy's for bad numbers
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            return reader(io.BytesIO(data), **how)
    except MemoryError:  # is no damage of the file
        raise
    except Exception as error:  # an untrusted file, read by a library that may raise any exception
        why = f"{type(error).__name__}: {' '.join(str(error).split()) or 'it is not complete'}"
        raise BadInput(f"the mesh is damaged: {why}", where=str(path), hint="export or download it again") from error


def as_array(values: Any, kind: type = np.float64) -> np.ndarray:
    return np.asarray(values).astype(kind)


def uv_of(visual: Any) -> np.ndarray | None:
    """Return texture coordinates of trimesh, whose v points up."""
    uv = getattr(visual, "uv", None)
    return None if uv is None else as_array(uv) * [1, -1] + [0, 1]


def optional(values: Any) -> np.ndarray | None:
    return None if values is None else as_array(values)


# Files that a mesh names, and pictures


def read_bytes(path: Path) -> bytes:
    """Return the content of a file; raise BadInput if it cannot be read or is larger than MAX_BYTES."""
    try:
        check_plain_file(path, max_bytes=MAX_BYTES)
        return path.read_bytes()
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error.strerror}") from error


def read_beside(name: str, mesh: Path, *, what: str) -> bytes:
    """Return the content of a file that a mesh names, which must be in its folder after links are followed."""
    folder = mesh.parent.resolve()
    hint = f"copy it beside {mesh.name} and name it from there"
    try:
        file = (folder / name.replace("\\", "/")).resolve(strict=True)
    except (OSError, RuntimeError, ValueError):  # also a circular link, a NUL, a name that is too long
        near = closest(PurePosixPath(name.replace("\\", "/")).name, [p.name for p in folder.iterdir()])
        raise BadInput(f"the {what} {name!r} does not exist", where=str(mesh), nearest=near, hint=hint) from None
    if not file.is_relative_to(folder):
        raise BadInput(f"the {what} {name!r} is outside the mesh's folder", where=str(mesh), hint=hint)
    return read_bytes(file)


class Pictures:
    """The pictures of a mesh, each decoded once, and of no more than MAX_PIXELS together."""

    def __init__(self, mesh: Path) -> None:
        self.mesh = mesh
        self._known: dict[object, np.ndarray] = {}

    def named(self, name: str) -> np.ndarray:
        """Return the picture in a file that the mesh names; see :meth:`pixels`."""
        data = b"" if name in self._known else read_beside(name, self.mesh, what="texture")
        return self.pixels(name, lambda: Image.open(io.BytesIO(data), formats=PICTURE_FORMATS), name=name)

    def pixels(self, key: object, opened: Callable[[], Any], *, name: str) -> np.ndarray:
        """Return the sRGB-coded colours and the opacity of one of Pillow's images, uint8 (rows, columns, 4).

        Raises BadInput if it is None or damaged, has other values than 8 bits or several pages, or is too large.
        """
        if key not in self._known:
            left = MAX_PIXELS - sum(known.shape[0] * known.shape[1] for known in self._known.values())
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("error", Image.DecompressionBombWarning)
                    warnings.simplefilter("ignore", UserWarning)  # about metadata
                    self._known[key] = _decode(opened(), most=left)
            except MemoryError:
                raise
            except Exception as error:  # an untrusted picture, read by a library that may raise any exception
                unknown = isinstance(error, UnidentifiedImageError)  # its message names the object in memory
                reason = "it is no picture" if unknown else " ".join(str(error).split())
                raise BadInput(
                    f"the texture {name!r} cannot be read: {reason}",
                    where=str(self.mesh),
                    allowed=", ".join(PICTURE_FORMATS),
                    hint="convert it to PNG of 8 bits",
                ) from error
        return self._known[key]


def _decode(image: Any, *, most: int) -> np.ndarray:
    """Return the pixels of an image, uint8 (rows, columns, 4); raise anything if it cannot be read."""
    if image is None or image.format not in PICTURE_FORMATS:
        raise ValueError("it is no picture")
    if image.width * image.height > most:
        raise ValueError(f"the textures have more than {MAX_PIXELS:,} pixels")
    if getattr(image, "n_frames", 1) > 1:
        raise ValueError("it has several pages")
    if image.mode not in PICTURE_MODES:
        raise ValueError(f"its values are of Pillow's mode {image.mode}, not grey or RGB of 8 bits")
    return np.asarray(image.convert("RGBA"))


def encode_png(pixels: np.ndarray) -> bytes:
    """Return a PNG file of uint8 pixels (rows, columns) or (rows, columns, 3)."""
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(buffer, "PNG")
    return buffer.getvalue()


def srgb_to_linear(coded: np.ndarray) -> np.ndarray:
    """Return linear values of sRGB-coded ones, both 0 to 1 (IEC 61966-2-1)."""
    return np.asarray(np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4))
