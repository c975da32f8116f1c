"""The pictures of a sweep as one image, row by row, of which a page can show one at a time."""

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image

from saf_gen.core.display_tone import encode_gamma, find_white_level

ACROSS = 8
WIDTH = 280
"""Largest width of one picture, pixels."""
WHITE_QUANTILE = 0.998  # the brightest pixels, glints, are cut off
QUALITIES, SHRINKAGES = (60, 40, 25, 15), (1, 1.5, 2, 3)


@dataclass(frozen=True)
class ImageStrip:
    """An image file of ``rows`` rows of ``columns`` pictures, each ``size`` (width, height) in pixels."""

    file: bytes
    media_type: str
    columns: int
    rows: int
    size: tuple[int, int]
    count: int


def build_image_strip(images: np.ndarray, *, max_bytes: int) -> ImageStrip:
    """Return pictures of linear light (n, h, w) as WebP, in at most ``max_bytes`` if any quality and size allows it.

    The quality falls first, then the size: noise needs many bytes, and averages out. All pictures have the same white,
    so that less light is darker.
    """
    rows, columns = images.shape[1:]
    white = find_white_level(images, quantile=WHITE_QUANTILE)
    for shrinkage in SHRINKAGES:
        width = max(round(min(columns, WIDTH) / shrinkage), 1)
        size = width, max(round(rows * width / columns), 1)
        greys = (255 * encode_gamma(_shrink(image, size), white) for image in images)
        sheet = _lay_out([grey.round().astype(np.uint8) for grey in greys])
        for quality in QUALITIES:
            file = _to_bytes(sheet, "WEBP", quality=quality)
            if len(file) <= max_bytes:
                return _describe(file, "image/webp", size=size, count=len(images))
    return _describe(file, "image/webp", size=size, count=len(images))


def build_spike_strip(spikes: np.ndarray) -> ImageStrip:
    """Return readouts (n, h, w) of 0 and 1 as PNG of one bit a pixel, spikes white."""
    sheet = _lay_out([np.asarray(frame, dtype=np.uint8) * 255 for frame in spikes]).convert("1")
    file = _to_bytes(sheet, "PNG", optimize=True)
    return _describe(file, "image/png", size=(spikes.shape[2], spikes.shape[1]), count=len(spikes))


def _shrink(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return an image (row, col) averaged to ``size`` (width, height): light is averaged before gamma encoding."""
    return np.asarray(Image.fromarray(image.astype(np.float32)).resize(size, Image.Resampling.BOX))


def _lay_out(pictures: Sequence[np.ndarray]) -> Image.Image:
    (height, width), across = pictures[0].shape, min(ACROSS, len(pictures))
    sheet = Image.new("L", (across * width, math.ceil(len(pictures) / across) * height))
    for number, picture in enumerate(pictures):
        sheet.paste(Image.fromarray(picture), (number % across * width, number // across * height))
    return sheet


def _to_bytes(sheet: Image.Image, image_format: str, **options: object) -> bytes:
    buffer = io.BytesIO()
    sheet.save(buffer, image_format, **options)
    return buffer.getvalue()


def _describe(file: bytes, media_type: str, *, size: tuple[int, int], count: int) -> ImageStrip:
    across = min(ACROSS, count)
    return ImageStrip(file, media_type, across, math.ceil(count / across), size, count)
