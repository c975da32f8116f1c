"""Pictures of a recording arranged in one image, from which a page or a notebook can show one at a time."""

import io
import math
from base64 import b64encode
from collections.abc import Iterable
from dataclasses import dataclass
from html import escape

import numpy as np
from PIL import Image

from saf_gen.core.plain_text import plural
from saf_gen.stream.description import describe_content
from saf_gen.stream.metadata import ReadableStream
from saf_gen.stream.pictures.timeline import choose_windows

ACROSS = 8
JPEG_QUALITIES = (85, 75, 60, 50, 40, 30, 22, 15, 10)


@dataclass(frozen=True)
class ImageStrip:
    """An image file of ``count`` pictures in ``rows`` and ``columns``, each of ``size`` (width, height) in pixels."""

    file: bytes
    media_type: str
    columns: int
    rows: int
    size: tuple[int, int]
    count: int


@dataclass(frozen=True)
class PictureSheet:
    """Pictures side by side in one image that is not yet encoded as a file."""

    image: Image.Image
    size: tuple[int, int]
    count: int

    def encode(self, form: str, **options: object) -> ImageStrip:
        """Return the pictures encoded in one of Pillow's formats, such as ``PNG``."""
        buffer, across = io.BytesIO(), min(ACROSS, self.count)
        self.image.save(buffer, form, **options)
        rows = math.ceil(self.count / across)
        return ImageStrip(buffer.getvalue(), f"image/{form.lower()}", across, rows, self.size, self.count)


def lay_out_pictures(pictures: Iterable[np.ndarray], *, count: int, two_tone: bool = False) -> PictureSheet:
    """Return ``count`` grey pictures, uint8 (h, w), side by side; ``two_tone`` keeps one bit per pixel."""
    across, mode = min(ACROSS, count), "1" if two_tone else "L"
    sheet, size = Image.new(mode, (1, 1)), (1, 1)
    for number, picture in enumerate(pictures):
        if number == 0:
            size = picture.shape[1], picture.shape[0]
            sheet = Image.new(mode, (across * size[0], math.ceil(count / across) * size[1]))
        cell = Image.fromarray(picture).convert(mode, dither=Image.Dither.NONE)
        sheet.paste(cell, (number % across * size[0], number // across * size[1]))
    return PictureSheet(sheet, size, count)


def encode_jpegs(sheet: PictureSheet, *, max_bytes: int) -> ImageStrip:
    """Return pictures as a JPEG of the best quality that fits in ``max_bytes``, or of the lowest if none does."""
    for quality in JPEG_QUALITIES:
        strip = sheet.encode("JPEG", quality=quality, optimize=True)
        if len(strip.file) <= max_bytes:
            break
    return strip


def shrink_picture(light: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return linear light (h, w) averaged to ``size`` (width, height), float32.

    Do not pass grey values: their mean is not the grey value of the mean light.
    """
    if size == light.shape[::-1]:
        return light.astype(np.float32)
    return np.asarray(Image.fromarray(light.astype(np.float32)).resize(size, Image.Resampling.BOX))


PICTURES, MAX_BYTES = 5, 300_000


def stream_html(stream: ReadableStream) -> str:
    """Return evenly spaced pictures of a stream and a table of facts as HTML without scripts.

    Only five windows are read, so that a long recording takes no more time than a short one.
    """
    pictures = choose_windows(stream, count=PICTURES)
    strip = encode_jpegs(lay_out_pictures(pictures, count=len(pictures.starts)), max_bytes=MAX_BYTES)
    source = f"data:{strip.media_type};base64,{b64encode(strip.file).decode()}"
    rows = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(text)}</td></tr>'
        for name, text in describe_content(stream, with_rates=False).items()
    )
    centres = ", ".join(f"{centre:,.0f}" for centre in pictures.centres)
    words = f"{pictures.window} frames each, around the frames {centres}"
    return (
        f"<div><b>{escape(stream.path.name)}</b><br>"
        f'<img style="max-width:100%" src="{source}" alt="{plural(strip.count, "picture")}: {words}"><br>'
        f"<small>{words}</small><table>{rows}</table></div>"
    )
