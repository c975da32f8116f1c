"""The pictures of a sweep as one image, row by row, of which a page can show one at a time."""

import io
import math
from dataclasses import dataclass

import numpy as np
from PIL import Image

from saf_gen.benchmark.thumbnails import Thumbnails

ACROSS = 8
WIDTH = 280
"""Largest width of one picture, pixels."""
WHITE_QUANTILE = 0.998  # the brightest pixels, glints, are cut off
GAMMA = 2.2
QUALITIES = (60, 50, 40, 30, 22, 15, 10)


@dataclass(frozen=True)
class ImageStrip:
    """A JPEG of ``rows`` rows of ``columns`` pictures, each ``size`` (width, height) in pixels."""

    jpeg: bytes
    columns: int
    rows: int
    size: tuple[int, int]
    count: int


def build_image_strip(pictures: Thumbnails, *, max_bytes: int) -> ImageStrip:
    """Return the pictures side by side, in at most ``max_bytes`` if the lowest quality allows it.

    All pictures have the same white, so that less light is darker.
    """
    count, rows, columns = pictures.images.shape
    width = min(columns, WIDTH)
    height = max(round(rows * width / columns), 1)
    white = float(np.quantile(pictures.images, WHITE_QUANTILE)) or 1.0
    across = min(ACROSS, count)
    sheet = Image.new("L", (across * width, math.ceil(count / across) * height))
    for number, counts in enumerate(pictures.images):
        # Light is averaged before gamma encoding.
        linear = Image.fromarray(counts.astype(np.float32) / white)
        small = np.asarray(linear.resize((width, height), Image.Resampling.BOX))
        grey = (255 * np.clip(small, 0, 1) ** (1 / GAMMA)).round().astype(np.uint8)
        sheet.paste(Image.fromarray(grey), (number % across * width, number // across * height))
    for quality in QUALITIES:
        buffer = io.BytesIO()
        sheet.save(buffer, "JPEG", quality=quality, optimize=True)
        if buffer.tell() <= max_bytes:
            break
    return ImageStrip(buffer.getvalue(), across, math.ceil(count / across), (width, height), count)
