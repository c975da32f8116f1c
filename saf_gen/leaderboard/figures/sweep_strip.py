"""The pictures of a sweep in one image, laid out row by row, so that a page can show one picture at a time."""

import itertools

import numpy as np

from saf_gen.core.display_tone import display_gamma, white_level
from saf_gen.stream.pictures.image_strip import ImageStrip, lay_out_pictures, shrink_picture

WIDTH = 280
"""Largest width of one picture, in pixels."""
WHITE_QUANTILE = 0.998  # glints, the brightest pixels, are clipped
QUALITIES, SHRINKAGES = (60, 40, 25, 15), (1, 1.5, 2, 3)
TRIED_FIRST, MARGIN = 8, 1.2
"""Every eighth picture is encoded first. If these exceed their part of the bytes by more than a factor of 1.2, the next
quality or size is tried, because all pictures would be too large."""


def build_figure_image_strip(images: np.ndarray, *, max_bytes: int) -> ImageStrip:
    """Return pictures of linear light (n, h, w) as WebP, in at most ``max_bytes`` if any quality and size allows it.

    The quality is reduced first, then the size, because noise needs many bytes and averages out in smaller pictures.
    All pictures have the same white level, so that less light looks darker. A few pictures are encoded first to skip
    qualities and sizes that would be too large.
    """
    white = white_level(images, quantile=WHITE_QUANTILE)
    few = images[::TRIED_FIRST]
    max_few_bytes = MARGIN * max_bytes * len(few) / len(images)
    *larger, (shrinkage, quality) = itertools.product(SHRINKAGES, QUALITIES)
    for shrunk, worse in larger:
        if len(_encode(few, white, shrinkage=shrunk, quality=worse).file) <= max_few_bytes:
            strip = _encode(images, white, shrinkage=shrunk, quality=worse)
            if len(strip.file) <= max_bytes:
                return strip
    return _encode(images, white, shrinkage=shrinkage, quality=quality)


def _encode(images: np.ndarray, white: float, *, shrinkage: float, quality: int) -> ImageStrip:
    rows, columns = images.shape[1:]
    width = max(round(min(columns, WIDTH) / shrinkage), 1)
    size = width, max(round(rows * width / columns), 1)
    greys = (255 * display_gamma(shrink_picture(image, size), white) for image in images)
    sheet = lay_out_pictures((grey.round().astype(np.uint8) for grey in greys), count=len(images))
    return sheet.encode("WEBP", quality=quality)


def build_figure_spike_strip(spikes: np.ndarray) -> ImageStrip:
    """Return readouts (n, h, w) of 0 and 1 as PNG with one bit per pixel, in which spikes are white."""
    greys = (np.asarray(frame, dtype=np.uint8) * 255 for frame in spikes)
    return lay_out_pictures(greys, count=len(spikes), two_tone=True).encode("PNG", optimize=True)
