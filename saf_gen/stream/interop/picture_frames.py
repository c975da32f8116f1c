"""Pictures of other cameras as linear light, read one at a time from a folder of images, a video or an array."""

import os
import re
from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import Any
from warnings import catch_warnings

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from saf_gen.core.extras import require_extra
from saf_gen.errors import BadInput
from saf_gen.stream.interop.array_files import DAMAGE, ENDINGS, SlicedArray, open_array
from saf_gen.stream.metadata import MAX_PIXELS

IMAGES = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".gif", ".pgm", ".ppm"})
FEW_NAMES = 3
"""Names of pictures that are listed from each end of a folder."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
"""Weights of linear red, green and blue (ITU-R BT.709), since a spike camera sees no colour."""


def decode_srgb(values: np.ndarray) -> np.ndarray:
    """Return the linear light, float32, of sRGB values from 0 to 1 (IEC 61966-2-1)."""
    v = np.asarray(values, np.float32)
    linear: np.ndarray = np.where(v <= 0.04045, v / 12.92, ((np.maximum(v, 0) + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


class PictureFrames:
    """Pictures as linear light, float32 (H, W), 0 and above; each iteration begins with the first.

    Attributes
    ----------
    path : Path
        Folder or file from which the pictures are read.
    linear : bool
        True if the values in the source are linear light already, False if they are sRGB, which is decoded.
    shape : tuple of int
        (H, W).
    rate_hz : float or None
        Pictures per second; None if the source does not state it.
    order : str
        The names of the first and last pictures of a folder, in the order in which they are read; otherwise ''.
    """

    rate_hz: float | None = None
    order: str = ""

    def __init__(self, path: Path, *, linear: bool, shape: tuple[int, ...]) -> None:
        if len(shape) != 2 or min(shape) < 1 or prod(shape) > MAX_PIXELS:
            raise BadInput(
                f"the pictures have the shape {shape}",
                where=str(path),
                allowed=f"rows and columns, at most {MAX_PIXELS} pixels",
            )
        self.path, self.linear, self.shape = path, linear, (int(shape[0]), int(shape[1]))

    def __iter__(self) -> Iterator[np.ndarray]:
        for name, values in self._read():
            if values.shape[:2] != self.shape:
                size = f"{name} has {values.shape[:2]} pixels"
                raise BadInput(size, where=str(self.path), allowed=f"{self.shape}, like the first")
            yield self._to_light(values, name=name)

    def _read(self) -> Iterator[tuple[str, np.ndarray]]:
        raise NotImplementedError

    def _to_light(self, values: np.ndarray, *, name: str) -> np.ndarray:
        """Return grey, RGB or RGBA values (H, W) or (H, W, c) as linear light; alpha is ignored."""
        kind = values.dtype.kind
        if kind not in "uf" or values.dtype.itemsize > 8:
            raise BadInput(f"{name} is {values.dtype}", where=str(self.path), allowed="uint8, uint16 or floats",
                           hint="use saf-gen import for spikes")  # fmt: skip
        scaled = values.astype(np.float32) / (1 if kind == "f" else np.iinfo(values.dtype).max)
        low, high = float(scaled.min()), float(scaled.max())
        if not (low >= 0 and high < np.inf and (self.linear or high <= 1)):
            allowed, hint = (
                ("0 and above", "") if self.linear else ("0 to 1", "add --linear if the values are linear light")
            )
            raise BadInput(f"{name} has values {low:g} to {high:g}", where=str(self.path), allowed=allowed, hint=hint)
        light = scaled if self.linear else decode_srgb(scaled)
        if light.ndim == 2:
            return light
        if light.ndim != 3 or light.shape[2] not in (1, 2, 3, 4):
            raise BadInput(f"{name} has shape {values.shape}", where=str(self.path), allowed="1 to 4 channels")
        return light[:, :, 0] if light.shape[2] < 3 else np.asarray(light[:, :, :3] @ LUMINANCE)


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
        names = [file.name for file in self._files]
        if is_folder and len(names) > 2 * FEW_NAMES:
            names[FEW_NAMES:-FEW_NAMES] = ["…"]
        self.order = ", ".join(names) if is_folder else ""
        if not is_folder:
            self.rate_hz = _page_rate(path)

    def _read(self) -> Iterator[tuple[str, np.ndarray]]:
        for file in self._files:
            for number, (values, _) in enumerate(_read_pages(file)):
                yield f"{file.name}{f', page {number + 1}' if number else ''}", values


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


def open_pictures(path: str | os.PathLike[str], *, linear: bool = False, key: str | None = None) -> PictureFrames:
    """Return the pictures in a folder of images, an image file with pages, or an array file; others are read as video.

    ``linear`` states that the values are linear light already, and ``key`` names the array in a file with several.

    Raises BadInput if the path is missing, cannot be read, or holds no pictures.
    """
    where = Path(path)
    if not where.exists():
        raise BadInput("there is no such file or folder", where=str(path))
    if key is not None and where.suffix.lower() not in ENDINGS:
        raise BadInput(
            f"--key {key} is given for pictures that are not in an array file", where=str(path), hint="leave it out"
        )
    if where.suffix.lower() == ".exr":
        raise BadInput(
            "is an OpenEXR file, which would lose its light above 1 and most of its bits", where=str(path),
            allowed="images, video or arrays", hint="save it as floats in a .npy file, and add --linear",
        )  # fmt: skip
    if where.is_dir() or where.suffix.lower() in IMAGES:
        return _ImageFiles(where, linear=linear)
    if where.suffix.lower() in ENDINGS:
        return _ArrayFrames(where, linear=linear, key=key)
    return _VideoFrames(where, linear=linear)
