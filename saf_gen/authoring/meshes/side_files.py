"""Files that a mesh names: they must be beside it, and pictures must be readable."""

import io
import warnings
from collections.abc import Callable, Hashable
from pathlib import Path, PurePosixPath, PureWindowsPath

import numpy as np
from PIL import Image, UnidentifiedImageError

from saf_gen.core.config.document import check_plain_file
from saf_gen.errors import BadInput, closest

MAX_BYTES = 1 << 29
MAX_PIXELS = 1 << 27
"""Of all pictures of a mesh together: eight of 4096 × 4096."""
PICTURE_FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "TGA", "BMP", "GIF", "DDS")


def read_bytes(path: Path) -> bytes:
    """Return the content of a file; raise BadInput if it cannot be read or is larger than MAX_BYTES."""
    try:
        check_plain_file(path, max_bytes=MAX_BYTES)
        return path.read_bytes()
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error.strerror}") from error


def find_side_file(name: str, mesh: Path, *, what: str) -> Path:
    """Return the path of a file that a mesh names.

    Parameters
    ----------
    name : str
        Name as written in the mesh, relative to its folder.
    mesh : Path
        The mesh.
    what : str
        What the file is, such as "texture", for messages.

    Raises
    ------
    BadInput
        If the file is missing, or is not in the mesh's folder after links are followed.
    """
    folder = mesh.parent.resolve()
    copy = f"copy it beside {mesh.name} and name it from there"
    if "://" in name or PureWindowsPath(name).anchor or PurePosixPath(name).anchor:
        raise BadInput(f"the {what} {name!r} is named by an absolute path", where=str(mesh), hint=copy)
    try:
        file = (folder / name.replace("\\", "/")).resolve()
        inside, there = file.is_relative_to(folder), file.is_file()
    except (OSError, RuntimeError, ValueError) as error:  # a circular link, a NUL, a name that is too long
        raise BadInput(f"the {what} {name!r} cannot be found: {error}", where=str(mesh)) from error
    if not inside:
        raise BadInput(f"the {what} {name!r} is outside the mesh's folder", where=str(mesh), hint=copy)
    if not there:
        neighbours = [p.name for p in file.parent.iterdir()] if file.parent.is_dir() else []
        near = closest(file.name, neighbours)
        raise BadInput(
            f"the {what} {name!r} does not exist",
            where=str(mesh),
            nearest=str(PurePosixPath(name.replace("\\", "/")).parent / near) if near else "",
            hint="export again with its files, or copy it there",
        )
    return file


class Pictures:
    """The pictures of a mesh, each decoded once, and of no more than MAX_PIXELS together."""

    def __init__(self, mesh: Path) -> None:
        self._mesh = mesh
        self._known: dict[Hashable, np.ndarray] = {}

    def named(self, name: str) -> np.ndarray:
        """Return the picture in a file that the mesh names; see :meth:`decode`."""
        file = find_side_file(name, self._mesh, what="texture")
        return self.decode(file, lambda: read_bytes(file), name=name)

    def decode(self, key: Hashable, load: Callable[[], bytes], *, name: str) -> np.ndarray:
        """Return the sRGB-coded colours and the opacity of a picture file, uint8 (rows, columns, 4).

        Parameters
        ----------
        key : hashable
            Key of the picture; ``load`` is called if it is new.
        load : callable
            Function that returns the content of the file.
        name : str
            Name of the picture, for messages.

        Raises
        ------
        BadInput
            If Pillow cannot read it, it has other values than 8 or 16 bits or several pages, or is too large.
        """
        if key not in self._known:
            left = MAX_PIXELS - sum(known.shape[0] * known.shape[1] for known in self._known.values())
            data = load()
            try:
                self._known[key] = _decode(data, most=left)
            except Exception as error:  # an untrusted picture, read by a library that may raise any exception
                unknown = isinstance(error, UnidentifiedImageError)  # its message names the object in memory
                reason, hint = "it is no picture" if unknown else " ".join(str(error).split()), "convert it to PNG"
                if data.startswith(b"\xabKTX 20"):
                    reason, hint = "it is a KTX2 file", "convert it to PNG, for glTF with gltf-transform ktxdecompress"
                raise BadInput(
                    f"the texture {name!r} cannot be read: {reason}",
                    where=str(self._mesh),
                    allowed=", ".join(PICTURE_FORMATS),
                    hint=hint,
                ) from error
        return self._known[key]


def _decode(data: bytes, *, most: int) -> np.ndarray:
    """Return the pixels of a picture file, uint8 (rows, columns, 4); raise anything if it cannot be read."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        warnings.simplefilter("ignore", UserWarning)  # about metadata
        with Image.open(io.BytesIO(data), formats=PICTURE_FORMATS) as picture:
            if picture.width * picture.height > most:
                raise ValueError(f"the textures have more than {MAX_PIXELS:,} pixels")
            if getattr(picture, "n_frames", 1) > 1:
                raise ValueError("it has several pages")
            if picture.mode.startswith("I;16"):
                grey = np.round(np.asarray(picture, dtype=np.float64) / 257).astype(np.uint8)
                return np.dstack([grey, grey, grey, np.full_like(grey, 255)])
            if picture.mode in ("I", "F"):
                raise ValueError(f"its values are of Pillow's mode {picture.mode}, not 8 or 16 bits")
            return np.asarray(picture.convert("RGBA"))


def encode_png(pixels: np.ndarray) -> bytes:
    """Return a PNG file of uint8 pixels (rows, columns) or (rows, columns, 3)."""
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(buffer, "PNG")
    return buffer.getvalue()
