"""Pictures of a recording as one image, row by row, of which a page can show one at a time."""

import io
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from PIL import Image

ACROSS = 8
QUALITIES = (85, 75, 60, 50, 40, 30, 22, 15, 10)


@dataclass(frozen=True)
class ImageStrip:
    """An image file of ``rows`` rows of ``columns`` pictures, each ``size`` (width, height) in pixels."""

    data: bytes
    media_type: str
    columns: int
    rows: int
    size: tuple[int, int]
    count: int


def build_image_strip(
    pictures: Iterable[np.ndarray], *, count: int, max_bytes: int, best_quality: int = 60, two_tone: bool = False
) -> ImageStrip:
    """Return ``count`` pictures, grey values uint8 (h, w), side by side as JPEG.

    The best quality, at most ``best_quality``, is taken that makes it at most ``max_bytes``, or the lowest there is.
    ``two_tone`` gives PNG with a bit per pixel instead, without loss.
    """
    across, sheet, size = min(ACROSS, count), Image.new("1" if two_tone else "L", (1, 1)), (1, 1)
    for number, picture in enumerate(pictures):
        if number == 0:
            size = picture.shape[1], picture.shape[0]
            sheet = Image.new(sheet.mode, (across * size[0], math.ceil(count / across) * size[1]))
        cell = Image.fromarray(picture).convert(sheet.mode, dither=Image.Dither.NONE)
        sheet.paste(cell, (number % across * size[0], number // across * size[1]))
    buffer = io.BytesIO()
    if two_tone:
        sheet.save(buffer, "PNG", optimize=True)
    for quality in () if two_tone else [q for q in QUALITIES if q <= best_quality]:
        buffer = io.BytesIO()
        sheet.save(buffer, "JPEG", quality=quality, optimize=True)
        if buffer.tell() <= max_bytes:
            break
    media_type = "image/png" if two_tone else "image/jpeg"
    return ImageStrip(buffer.getvalue(), media_type, across, math.ceil(count / across), size, count)


def shrink_picture(light: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return linear light (h, w) averaged over the pixels of a smaller picture of ``size`` (width, height), float32."""
    if size == light.shape[::-1]:
        return light.astype(np.float32)
    return np.asarray(Image.fromarray(light.astype(np.float32)).resize(size, Image.Resampling.BOX))
