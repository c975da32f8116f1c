"""The pages of one image file with all their bits, and what the file says about their time and their light."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from io import SEEK_CUR
from math import log
from pathlib import Path
from typing import Literal
from warnings import catch_warnings

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from saf_gen.errors import BadInput
from saf_gen.stream.interop.array_files import DAMAGE
from saf_gen.stream.interop.linear_light import LINEAR, SRGB, Transfer, find_transfer, power_law
from saf_gen.stream.interop.stated_length import find_cut
from saf_gen.stream.interop.video_frames import decode_image
from saf_gen.stream.metadata import MAX_PIXELS

ORIENTATION, BITS_PER_SAMPLE, PHOTOMETRIC, WHITE_IS_ZERO = 0x0112, 258, 262, 0
DEEP_CODECS = {"PNG": "png", "TIFF": "tiff", "PPM": "ppm"}
LONGEST_DIVISOR = 65_535
"""APNG states a duration as a fraction of two numbers of 16 bits; GIF and WebP state hundredths and thousandths."""
SRGB_AT_HALF, TOLERANCE = 0.214, 0.015
"""The light of half of the largest value in sRGB, and how far other curves may be from it to be taken as sRGB."""


@dataclass(frozen=True)
class Page:
    """A page turned upright.

    ``values`` are grey, RGB or RGBA (H, W) or (H, W, c); ``seconds`` is how long the page lasts, 0 if the file does not
    say; ``transfer`` is how the file says that values stand for light, sRGB if it says nothing; and ``primaries`` is
    their number in ITU-T H.273.
    """

    values: np.ndarray
    seconds: Fraction
    transfer: Transfer
    primaries: int


def read_pages(path: Path, *, linear: bool) -> Iterator[Page]:
    """Yield each page of an image file; ``linear`` states that its values are linear light, whatever the file says.

    Raises BadInput if the file is damaged, has no picture, or has colours that cannot be read as they are meant.
    """
    try:
        if not path.is_file():  # opening a pipe would wait for ever
            raise ValueError("not a file on a disk")
        if cut := find_cut(path):
            raise ValueError(cut)
        # Pillow's warnings are harmless or reported as errors below. Given a name, it would map a TIFF into memory, and
        # mix up the pixels of one that lies on its side.
        with catch_warnings(action="ignore"), path.open("rb") as file, Image.open(file) as image:
            if image.width * image.height > MAX_PIXELS:
                size = f"has {image.width} × {image.height} pixels"
                raise BadInput(size, where=str(path), allowed=f"at most {MAX_PIXELS}")
            transfer, primaries = _read_light(path, image, linear=linear)
            for number in range(getattr(image, "n_frames", 1)):
                image.seek(number)
                deep = _is_deep(image, path)
                if deep and number and image.format != "TIFF":
                    raise BadInput("is an animation of 16 bits", where=str(path), allowed="single pictures, or 8 bits")
                turned = image.getexif().get(ORIENTATION, 1) if deep else 1
                image.load()  # Pillow forgets the orientation of a TIFF here, and may find that of a PNG
                if deep:
                    data = _begin_with(path.read_bytes(), number) if number else path.read_bytes()
                    values = decode_image(data, DEEP_CODECS[image.format or ""], where=path)
                    values = _upright(values, max(turned, image.getexif().get(ORIENTATION, 1)))
                else:
                    values = _shallow_values(image)
                duration = Fraction(float(image.info.get("duration", 0)) / 1000).limit_denominator(LONGEST_DIVISOR)
                yield Page(values, duration, transfer, primaries)
    except UnidentifiedImageError as error:  # an OSError
        raise BadInput(
            "cannot be read: it is no picture of a known format", where=str(path), allowed="a picture"
        ) from error
    except (*DAMAGE, SyntaxError, Image.DecompressionBombError) as error:
        raise BadInput(f"cannot be read: {error}", where=str(path), allowed="a picture") from error


def _shallow_values(image: Image.Image) -> np.ndarray:
    """Return the values of a page of which Pillow keeps every bit."""
    tags = getattr(image, "tag_v2", {})
    page = ImageOps.exif_transpose(image)
    if page.mode in ("P", "1", "CMYK", "YCbCr", "LAB", "HSV", "PA"):
        page = page.convert("RGB")
    values = np.asarray(page)
    if values.dtype == np.int32 and values.min(initial=0) >= 0 and values.max(initial=0) < 1 << 16:
        values = values.astype(np.uint16)  # Pillow returns some 16-bit files as int32
    if values.dtype == np.uint16 and tags.get(BITS_PER_SAMPLE) == (12,):
        values = values / np.float32(4095)
    if values.dtype == np.uint16 and tags.get(PHOTOMETRIC) == WHITE_IS_ZERO:
        values = 65_535 - values
    return values


def _is_deep(image: Image.Image, path: Path) -> bool:
    """Return whether a page has 16 bits per channel in colour or with alpha, of which Pillow keeps 8."""
    if image.format == "PNG":
        with path.open("rb") as file:
            head = file.read(26)
        return head[24] == 16 and head[25] != 0
    if image.format == "PPM" and image.mode == "RGB":
        with path.open("rb") as file:
            words = b" ".join(line.partition(b"#")[0] for line in file.read(4096).split(b"\n")).split()
        return int(words[3]) > 255
    if image.format == "TIFF" and image.mode in ("RGB", "RGBA", "RGBX", "CMYK", "LAB", "YCbCr", "LA"):
        deep = max(image.tag_v2.get(BITS_PER_SAMPLE, (8,))) > 8  # type: ignore[attr-defined]
        if deep and not image.mode.startswith("RGB"):
            raise BadInput(
                f"has more than 8 bits per channel in {image.mode}", where=str(path), allowed="grey or RGB of 16 bits"
            )
        return deep
    return False


def _begin_with(data: bytes, number: int) -> bytes:
    """Return a TIFF whose first page is this one; ffmpeg decodes the first."""
    order: Literal["little", "big"] = "little" if data[:2] == b"II" else "big"
    at = int.from_bytes(data[4:8], order)
    for _ in range(number):
        at += 2 + 12 * int.from_bytes(data[at : at + 2], order)
        at = int.from_bytes(data[at : at + 4], order)
    return data[:4] + at.to_bytes(4, order) + data[8:]


def _upright(values: np.ndarray, orientation: int) -> np.ndarray:
    """Return values (H, W, …) turned and mirrored as the orientation of Exif asks for."""
    if orientation >= 5:
        values = np.swapaxes(values, 0, 1)
    up = orientation in (3, 4, 7, 8)
    left = orientation in (2, 3, 6, 7)
    return values[:: -1 if up else 1, :: -1 if left else 1]


def _read_light(path: Path, image: Image.Image, *, linear: bool) -> tuple[Transfer, int]:
    """Return how a file says that its values stand for light, and its primaries.

    In a PNG, the chunk cICP counts before an ICC profile, that before sRGB, and that before gAMA (third edition, 4.3).
    """
    chunks = _png_chunks(path) if image.format == "PNG" else {}
    if len(code := chunks.get(b"cICP", b"")) == 4:
        if code[2] != 0 or code[3] != 1:
            raise BadInput("has a cICP chunk of YUV or limited range", where=str(path), allowed="RGB of full range")
        return LINEAR if linear else find_transfer(code[1], where=path), code[0]
    if linear:
        return LINEAR, 1
    if profile := image.info.get("icc_profile"):
        half = _profile_at_half(profile)
    elif gamma := int.from_bytes(chunks.get(b"gAMA", b"")) * (b"sRGB" not in chunks):
        half = 0.5 ** (100_000 / gamma)
    else:
        half = SRGB_AT_HALF
    if abs(half - SRGB_AT_HALF) < TOLERANCE:
        return SRGB, 1
    exponent = round(log(half) / log(0.5), 4)
    return (LINEAR if exponent == 1 else power_law(exponent)), 1


def _png_chunks(path: Path) -> dict[bytes, bytes]:
    """Return the short chunks of a PNG before its pixels, by their names."""
    chunks = {}
    with path.open("rb") as file:
        file.seek(8)
        while len(head := file.read(8)) == 8 and head[4:] not in (b"IDAT", b"IEND"):
            length = int.from_bytes(head[:4])
            chunks[head[4:]] = file.read(min(length, 64))
            file.seek(max(length - 64, 0) + 4, SEEK_CUR)
    return chunks


def _profile_at_half(profile: bytes) -> float:
    """Return the light that an ICC profile assigns to half of the largest value, that of sRGB if it has no such curve.

    Curves are tables, powers or formulas (ICC.1:2022, 10.6 and 10.18).
    """
    curve = b""
    for number in range(min(int.from_bytes(profile[128:132]), 100)):
        name, offset, length = struct.unpack(">4sII", profile[132 + 12 * number :][:12])
        if name in (b"gTRC", b"kTRC"):
            curve = profile[offset:][:length]
    if curve[:4] == b"curv":
        table = np.frombuffer(curve[12 : 12 + 2 * int.from_bytes(curve[8:12])], ">u2").astype(float)
        if len(table) < 2:
            return 0.5 ** (table[0] / 256) if len(table) else 0.5
        return float(np.interp((len(table) - 1) / 2, np.arange(len(table)), table)) / 65_535
    if curve[:4] == b"para":
        kind, count = int.from_bytes(curve[8:10]), len(curve[12:40]) // 4
        numbers = np.frombuffer(curve[12 : 12 + 4 * count], ">i4") / 65_536
        g, a, b, c, d, e, f = np.pad(numbers, (0, 7 - count)).tolist()
        if kind == 0:
            return float(0.5**g)
        if (d if kind > 2 else -b / a) > 0.5:  # in the straight part near black
            return c / 2 + f if kind > 2 else c
        return float((a / 2 + b) ** g + (c if kind == 2 else e))
    return SRGB_AT_HALF
