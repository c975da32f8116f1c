"""Pictures of other cameras as linear light, read one at a time from a folder of images, a video or an array."""

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from warnings import catch_warnings

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from saf_gen.core.extras import require_extra
from saf_gen.errors import BadInput
from saf_gen.stream.interop.array_files import DAMAGE, ENDINGS, SlicedArray, open_array
from saf_gen.stream.interop.exr_frames import ExrFrames
from saf_gen.stream.interop.linear_light import PictureFrames
from saf_gen.stream.interop.stack_positions import read_stack_positions
from saf_gen.stream.metadata import MAX_PIXELS

IMAGES = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".gif", ".pgm", ".ppm"})
EXR = ".exr"
FEW_NAMES = 3
"""Names of pictures that are listed from each end of a folder."""


class _ImageFiles(PictureFrames):
    """The pictures of a folder in the order of the numbers in their names, or of a single file, page after page."""

    def __init__(self, path: Path, *, linear: bool) -> None:
        is_folder = path.is_dir()
        files = (p for p in path.iterdir() if p.suffix.lower() in IMAGES) if is_folder else [path]
        self._files = sorted(files, key=_number_sort_key)
        if not self._files:
            raise BadInput("has no picture", where=str(path), allowed=f"files {', '.join(sorted(IMAGES))}")
        first, _ = next(_read_pages(self._files[0]))
        super().__init__(path, linear=linear, shape=first.shape[:2])
        self.order = _name_order(self._files) if is_folder else ""
        if not is_folder:
            self.rate_hz = _page_rate(path)
            self.positions = read_stack_positions(path)

    def _read(self) -> Iterator[tuple[str, np.ndarray]]:
        for file in self._files:
            for number, (values, _) in enumerate(_read_pages(file)):
                yield f"{file.name}{f', page {number + 1}' if number else ''}", values


def _name_order(files: list[Path]) -> str:
    names = [file.name for file in files]
    if len(names) > 2 * FEW_NAMES:
        names[FEW_NAMES:-FEW_NAMES] = ["…"]
    return ", ".join(names)


def _number_sort_key(path: Path) -> list[Any]:
    """Return a sort key that puts frame_10 after frame_9, z_0.15 before z_0.3, and z_-3 before z_2.

    A hyphen is a sign unless it follows a letter or digit, as in scene-1; 1.2.3 is three numbers.
    """
    parts = re.split(r"((?<![A-Za-z0-9])[-+]?(?<![\d.])\d+\.\d+(?![.\d])|(?<![A-Za-z0-9])[-+]\d+|\d+)", path.stem)
    return [(float(part), "") if number % 2 else (-np.inf, part) for number, part in enumerate(parts)]


def _read_pages(path: Path) -> Iterator[tuple[np.ndarray, float]]:
    """Yield the values of each page of an image file, turned upright, and its duration in ms, 0 if it states none."""
    try:
        if not path.is_file():  # opening a pipe would wait for ever
            raise ValueError("not a file on a disk")
        # Pillow's warnings are harmless or reported as errors below.
        with catch_warnings(action="ignore"), Image.open(path) as image:
            if image.width * image.height > MAX_PIXELS:
                size = f"has {image.width} × {image.height} pixels"
                raise BadInput(size, where=str(path), allowed=f"at most {MAX_PIXELS}")
            if image.format == "PNG" and _is_deep_colour(path):
                raise BadInput(
                    "has 16 bits per colour, of which only 8 can be read", where=str(path),
                    allowed="grey of 16 bits, colour of 8 bits, or an array (.npy) of either",
                )  # fmt: skip
            for number in range(getattr(image, "n_frames", 1)):
                image.seek(number)
                image.load()
                page = ImageOps.exif_transpose(image)
                if page.mode in ("P", "1", "CMYK", "YCbCr", "LAB", "HSV", "PA"):
                    page = page.convert("RGB")
                values = np.asarray(page)
                if values.dtype == np.int32 and values.min(initial=0) >= 0 and values.max(initial=0) < 1 << 16:
                    values = values.astype(np.uint16)  # Pillow returns some 16-bit files as int32
                yield values, float(image.info.get("duration", 0))
    except (*DAMAGE, SyntaxError, UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise BadInput(f"cannot be read: {error}", where=str(path), allowed="a picture") from error


def _is_deep_colour(path: Path) -> bool:
    """Return whether a PNG has 16 bits per channel in colour or with alpha, of which Pillow keeps 8."""
    with path.open("rb") as file:
        head = file.read(26)
    return head[24] == 16 and head[25] != 0


def _page_rate(path: Path) -> float | None:
    """Return the pages per second that a file states, or None; raise BadInput if its pages last for different times."""
    durations = [duration for _, duration in _read_pages(path)]
    if len(durations) < 2 or not any(durations):
        return None
    if len(set(durations)) > 1:
        raise BadInput(
            f"its pages last from {min(durations):g} to {max(durations):g} ms", where=str(path),
            allowed="pages that last for the same time", hint="save them as single pictures, and add --rate HZ",
        )  # fmt: skip
    return 1000 / durations[0]


class _ArrayFrames(PictureFrames):
    def __init__(self, path: Path, *, linear: bool, key: str | None) -> None:
        self._array: SlicedArray = open_array(path, key=key)
        shape = self._array.shape
        if len(shape) not in (3, 4) or 0 in shape:
            axes = "(frames, rows, columns) or (frames, rows, columns, channels)"
            raise BadInput(f"the array has shape {shape}", where=str(path), allowed=axes)
        super().__init__(path, linear=linear, shape=shape[1:3])

    def _read(self) -> Iterator[tuple[str, np.ndarray]]:
        for number in range(self._array.shape[0]):
            yield f"frame {number}", self._array[slice(number, number + 1)][0]


class _VideoFrames(PictureFrames):
    """Pictures of a video, decoded to 8 bits by the ffmpeg of imageio-ffmpeg in a separate process."""

    def __init__(self, path: Path, *, linear: bool) -> None:
        require_extra("video", "imageio_ffmpeg", of=f"a video ({path.name})")
        frames = self._decode(path)
        meta = next(frames)
        frames.close()
        if meta["fps"] > 0:
            self.rate_hz = float(meta["fps"])
        super().__init__(path, linear=linear, shape=meta["size"][::-1])

    @staticmethod
    def _decode(path: Path) -> Any:
        import imageio_ffmpeg

        # An untrusted playlist may name other files or hosts.
        frames = imageio_ffmpeg.read_frames(str(path.absolute()), input_params=["-protocol_whitelist", "file,pipe"])
        try:
            yield from frames
        except (OSError, RuntimeError, StopIteration, KeyError, AttributeError) as error:
            raise BadInput("cannot be decoded", where=str(path), allowed="a video that ffmpeg knows") from error

    def _read(self) -> Iterator[tuple[str, np.ndarray]]:
        frames = self._decode(self.path)
        next(frames)
        for number, data in enumerate(frames):
            yield f"frame {number}", np.frombuffer(data, np.uint8).reshape(*self.shape, 3)


def _list_exr(path: Path) -> list[Path]:
    """Return the OpenEXR files of a folder in the order of the numbers in their names, or ``path`` if it is one.

    Raises BadInput for a folder that holds other images as well, whose light is stored in another way.
    """
    if not path.is_dir():
        return [path] if path.suffix.lower() == EXR else []
    files = [file for file in path.iterdir() if file.suffix.lower() in (EXR, *IMAGES)]
    found = {file.suffix.lower() for file in files}
    if EXR in found and len(found) > 1:
        raise BadInput(
            f"has both {EXR} and {', '.join(sorted(found - {EXR}))} files", where=str(path),
            allowed="OpenEXR files alone, or none", hint="put them in folders of their own",
        )  # fmt: skip
    return sorted(files, key=_number_sort_key) if EXR in found else []


def open_pictures(path: str | os.PathLike[str], *, linear: bool = False, key: str | None = None) -> PictureFrames:
    """Return the pictures in a folder of images, an image file with pages, or an array file; others are read as video.

    ``linear`` states that the values are linear light already, as those of OpenEXR files always are. ``key`` names the
    array in a file with several, or the layer of OpenEXR files.

    Raises BadInput if the path is missing, cannot be read, or holds no pictures.
    """
    where = Path(path)
    if not where.exists():
        raise BadInput("there is no such file or folder", where=str(path))
    if exr := _list_exr(where):
        pictures = ExrFrames(where, exr, key=key)
        pictures.order = _name_order(exr) if where.is_dir() else ""
        return pictures
    if key is not None and where.suffix.lower() not in ENDINGS:
        raise BadInput(
            f"--key {key} is given for pictures that are neither in an array file nor in OpenEXR files",
            where=str(path), hint="leave it out",
        )  # fmt: skip
    if where.is_dir() or where.suffix.lower() in IMAGES:
        return _ImageFiles(where, linear=linear)
    if where.suffix.lower() in ENDINGS:
        return _ArrayFrames(where, linear=linear, key=key)
    return _VideoFrames(where, linear=linear)
