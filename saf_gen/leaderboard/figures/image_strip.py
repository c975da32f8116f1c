"""The pictures of a sweep as one image, row by row: what a page can show one at a time."""

import io
import math
from dataclasses import dataclass

import numpy as np
from PIL import Image

from saf_gen.benchmark.thumbnails import Thumbnails

__all__ = ["ImageStrip", "build_image_strip"]

ACROSS = 8
WIDTH = 280
"""Pixels of one picture; a smaller sensor keeps its own."""
WHITE_SHARE = 0.998  # of the pixels lie below white
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
    """The pictures side by side, below ``max_bytes`` where the lowest quality still allows it.

    All have the same white: where the light is less they are darker. A few glints are cut off.
    """
    count, rows, columns = pictures.images.shape
    width = min(columns, WIDTH)
    height = max(round(rows * width / columns), 1)
    white = float(np.quantile(pictures.images, WHITE_SHARE)) or 1.0
    across = min(ACROSS, count)
    sheet = Image.new("L", (across * width, math.ceil(count / across) * height))
    for number, counts in enumerate(pictures.images):
        # Averaging is of light, so it comes before the encoding for the eye.
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
