"""The pictures of a sweep as one image, row by row, of which a page can show one at a time."""

import itertools

import numpy as np

from saf_gen.core.display_tone import apply_display_gamma, find_display_white_level
from saf_gen.stream.pictures.image_strip import ImageStrip, lay_out_stream_pictures, shrink_stream_picture

WIDTH = 280
"""Largest width of one picture, pixels."""
WHITE_QUANTILE = 0.998  # the brightest pixels, glints, are cut off
QUALITIES, SHRINKAGES = (60, 40, 25, 15), (1, 1.5, 2, 3)
TRIED_FIRST, MARGIN = 8, 1.2
"""Every eighth picture is encoded before all are, which are left out where these few are larger than their fraction of
the bytes by more than this factor."""


def build_figure_image_strip(images: np.ndarray, *, max_bytes: int) -> ImageStrip:
    """Return pictures of linear light (n, h, w) as WebP, in at most ``max_bytes`` if any quality and size allows it.

    The quality falls first, then the size: noise needs many bytes, and averages out. All pictures have the same white,
    so that less light is darker. A few of the pictures tell which qualities and sizes are not worth a try with all.
    """
    white = find_display_white_level(images, quantile=WHITE_QUANTILE)
    few = images[::TRIED_FIRST]
    most = MARGIN * max_bytes * len(few) / len(images)
    *larger, (shrinkage, quality) = itertools.product(SHRINKAGES, QUALITIES)
    for shrunk, worse in larger:
        if len(_encode(few, white, shrinkage=shrunk, quality=worse).file) <= most:
            strip = _encode(images, white, shrinkage=shrunk, quality=worse)
            if len(strip.file) <= max_bytes:
                return strip
    return _encode(images, white, shrinkage=shrinkage, quality=quality)


def _encode(images: np.ndarray, white: float, *, shrinkage: float, quality: int) -> ImageStrip:
    rows, columns = images.shape[1:]
    width = max(round(min(columns, WIDTH) / shrinkage), 1)
    size = width, max(round(rows * width / columns), 1)
    greys = (255 * apply_display_gamma(shrink_stream_picture(image, size), white) for image in images)
    sheet = lay_out_stream_pictures((grey.round().astype(np.uint8) for grey in greys), count=len(images))
    return sheet.encode("WEBP", quality=quality)


def build_figure_spike_strip(spikes: np.ndarray) -> ImageStrip:
    """Return readouts (n, h, w) of 0 and 1 as PNG of one bit a pixel, spikes white."""
    greys = (np.asarray(frame, dtype=np.uint8) * 255 for frame in spikes)
    return lay_out_stream_pictures(greys, count=len(spikes), two_tone=True).encode("PNG", optimize=True)
