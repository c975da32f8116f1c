"""Pictures of other cameras as linear light, read one at a time from a folder of images, a video or an array."""

import os
import re
from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import Any
from warnings import catch_warnings

import numpy as np
from PIL import Image, UnidentifiedImageError

from saf_gen.core.extras import require_extra
from saf_gen.errors import BadInput
from saf_gen.stream.interop.array_files import DAMAGE, ENDINGS, SlicedArray, open_array
from saf_gen.stream.metadata import MAX_PIXELS

IMAGES = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm"})
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
    """

    rate_hz: float | None = None

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


class _ImageFolder(PictureFrames):
    def __init__(self, path: Path, *, linear: bool) -> None:
        self._files = sorted((p for p in path.iterdir() if p.suffix.lower() in IMAGES), key=_natural_sort_key)
        if not self._files:
            raise BadInput("has no picture", where=str(path), allowed=f"files {', '.join(sorted(IMAGES))}")
        first = _open_image(self._files[0])
        super().__init__(path, linear=linear, shape=(first.height, first.width))

    def _read(self) -> Iterator[tuple[str, np.ndarray]]:
        for file in self._files:
            image = _open_image(file)
            if image.mode in ("P", "1", "CMYK", "YCbCr", "LAB", "HSV", "PA"):
                image = image.convert("RGB")
            values = np.asarray(image)
            if values.dtype == np.int32 and values.min(initial=0) >= 0 and values.max(initial=0) < 1 << 16:
                values = values.astype(np.uint16)  # Pillow returns some 16-bit files as int32
            yield file.name, values


def _natural_sort_key(path: Path) -> list[Any]:
    """Return a sort key that puts frame_10 after frame_9."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", path.name)]


def _open_image(path: Path) -> Image.Image:
    try:
        if not path.is_file():  # opening a pipe would wait for ever
            raise ValueError("not a file on a disk")
        # Pillow's warnings are harmless or reported as errors below.
        with catch_warnings(action="ignore"), Image.open(path) as image:
            if image.width * image.height > MAX_PIXELS:
                size = f"has {image.width} × {image.height} pixels"
                raise BadInput(size, where=str(path), allowed=f"at most {MAX_PIXELS}")
            image.load()
    except (*DAMAGE, SyntaxError, UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise BadInput(f"cannot be read: {error}", where=str(path), allowed="a picture") from error
    return image


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
    """Return the pictures in a folder of images or an array file; any other file is read as a video.

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
    if where.is_dir():
        return _ImageFolder(where, linear=linear)
    if where.suffix.lower() in ENDINGS:
        return _ArrayFrames(where, linear=linear, key=key)
    return _VideoFrames(where, linear=linear)
