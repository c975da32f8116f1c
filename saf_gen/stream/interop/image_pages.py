"""The pictures of an image file: one of most formats, read by Pillow, or the pages of a TIFF, read by tifffile."""

import logging
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING
from warnings import catch_warnings

import numpy as np
from PIL import Image, ImageFile, ImageOps, UnidentifiedImageError

from saf_gen.errors import BadInput
from saf_gen.stream.interop.array_files import DAMAGE
from saf_gen.stream.interop.linear_light import SRGB, Transfer
from saf_gen.stream.interop.stated_length import find_cut
from saf_gen.stream.metadata import MAX_PIXELS

if TYPE_CHECKING:
    from tifffile import TiffPage

TIFF = (".tif", ".tiff")
ORIENTATION, EXIF, COLOUR_SPACE, EXIF_SRGB = 0x0112, 0x8769, 0xA001, 1
FORMATS = ("PNG", "JPEG", "BMP", "WEBP", "PPM")
"""By their names in Pillow, which knows a picture by its content."""
MODES = {"L": "L", "LA": "LA", "RGB": "RGB", "RGBA": "RGBA", "P": "RGB", "1": "L", "I;16": "I;16", "I": "I"}
"""Modes of Pillow that keep every bit of a file, and as what they are read; I are the 16 bits of older releases."""
STORED = ("NONE", "ADOBE_DEFLATE", "DEFLATE", "PACKBITS", "LZW")
"""Compressions of TIFF; of LZW, tifffile needs another package."""


def read_pages(path: Path) -> Iterator[tuple[np.ndarray, Transfer | None]]:
    """Yield each picture of a file, turned upright, and how it says that its values stand for light.

    The values are grey, RGB or RGBA (H, W) or (H, W, c).

    Raises BadInput if the file is damaged, or stores its pictures in a way in which they cannot be read as meant.
    """
    try:
        if not path.is_file():  # opening a pipe would wait for ever
            raise ValueError("not a file on a disk")
        if path.suffix.lower() in TIFF:
            yield from ((page, None) for page in _read_tiff(path))
        else:
            yield _read_picture(path)
    except UnidentifiedImageError as error:  # an OSError
        raise BadInput(
            "cannot be read: it is no picture of a known format", where=str(path), allowed="a picture"
        ) from error
    except (*DAMAGE, Image.DecompressionBombError) as error:
        hint = ""
        if "imagecodecs" in str(error):
            hint = "save it without compression, or pip install imagecodecs"
        raise BadInput(f"cannot be read: {error}", where=str(path), allowed="a picture", hint=hint) from error


def _check_pixels(rows: int, columns: int, *, path: Path) -> None:
    if rows * columns > MAX_PIXELS:
        raise BadInput(f"has {columns} × {rows} pixels", where=str(path), allowed=f"at most {MAX_PIXELS}")


def _read_picture(path: Path) -> tuple[np.ndarray, Transfer | None]:
    """Return the only picture of a file that Pillow reads, and sRGB if the file states it."""
    if cut := find_cut(path):
        raise ValueError(cut)
    with catch_warnings(action="ignore"), path.open("rb") as file, Image.open(file, formats=FORMATS) as image:
        _check_pixels(image.height, image.width, path=path)
        if getattr(image, "n_frames", 1) > 1 and image.format != "MPO":  # phones add maps to the picture of a JPEG
            raise BadInput(
                "is an animation", where=str(path), allowed="one picture a file, a TIFF of pages, or a video",
                hint="ffmpeg -i FILE -c:v ffv1 -pix_fmt bgr0 NEW.mkv",
            )  # fmt: skip
        if image.mode not in MODES or _is_deep(image):
            stored = f"{image.mode} of 16 bits" if image.mode in MODES else image.mode
            raise BadInput(
                f"is stored as {stored}", where=str(path), allowed="8 bits of grey or RGB, or 16 bits of grey",
                hint="save it as TIFF, of which all 16 bits per colour are read",
            )  # fmt: skip
        image.load()
        exif = image.getexif()
        states_srgb = "srgb" in image.info or exif.get_ifd(EXIF).get(COLOUR_SPACE) == EXIF_SRGB
        # What these say counts before it, and is left to the user.
        states_srgb &= "icc_profile" not in image.info and b"cICP" not in path.read_bytes()
        values = np.asarray(ImageOps.exif_transpose(image).convert(MODES[image.mode]))
    return values.astype(np.uint16) if values.dtype == np.int32 else values, SRGB if states_srgb else None


def _is_deep(image: ImageFile.ImageFile) -> bool:
    """Return whether a PNG or PPM has 16 bits per colour, of which Pillow keeps 8."""
    *_, unpacking = image.tile[0] if image.tile else ("",)
    if image.format == "PPM":
        return image.mode == "RGB" and isinstance(unpacking, tuple) and unpacking[1] > 255
    return image.format == "PNG" and ";16" in str(unpacking) and image.mode[0] != "I"


def _read_tiff(path: Path) -> Iterator[np.ndarray]:
    """Yield the pages of a TIFF."""
    from tifffile import TiffFile

    with _refuse_errors(), TiffFile(path) as file:
        if not len(file.pages):
            raise ValueError("it has no page")
        for page in file.pages:
            _check_page(page, path=path)  # type: ignore[arg-type]
            values = page.asarray()
            tag = page.tags.get(ORIENTATION)  # type: ignore[union-attr]
            values = _upright(values, int(tag.value) if tag else 1)
            yield values.astype(np.uint8) * 255 if values.dtype == bool else values


def _check_page(page: "TiffPage", *, path: Path) -> None:
    """Raise BadInput unless a page has grey or colours of whole bytes, all of them in the file, and no more."""
    _check_pixels(page.imagelength, page.imagewidth, path=path)
    kind = getattr(page.photometric, "name", page.photometric)
    packing = "NONE" if page.compression == 1 else str(getattr(page.compression, "name", page.compression))
    bits = page.bitspersample
    if (kind, page.axes) not in (("MINISBLACK", "YX"), ("RGB", "YXS")) or page.samplesperpixel > 4:
        stored = f"{kind} of {page.samplesperpixel} samples, axes {page.axes}"
    elif page.dtype is None or bits not in (1, 8 * page.dtype.itemsize):
        stored = f"{bits} bits a sample"
    elif packing not in STORED:
        stored = packing
    else:
        stored = ""
    if stored:
        raise BadInput(
            f"stores a page as {stored}", where=str(path),
            allowed="grey (0 is black) or RGB of 8 or 16 bits or floats, plain or by deflate", hint="save it again so",
        )  # fmt: skip
    size = prod(page.chunks) * max(bits // 8, 1)
    for at, count in zip(page.dataoffsets, page.databytecounts, strict=True):
        if not count:  # tifffile would return zeros
            raise ValueError("a part of a page is missing")
        if packing.endswith("DEFLATE"):  # tifffile would unpack gigabytes of zeros
            page.parent.filehandle.seek(at)
            packed = page.parent.filehandle.read(count)
            if len(zlib.decompressobj().decompress(packed, size + 1)) > size:
                raise ValueError("a part of a page has more bytes than it states")


@contextmanager
def _refuse_errors() -> Iterator[None]:
    """Raise what tifffile would report as an error, such as that the next page lies beyond the end of the file."""

    class Refusal(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.levelno >= logging.ERROR:
                raise ValueError(record.getMessage())

    logger, handler = logging.getLogger("tifffile"), Refusal()
    before = logger.propagate
    logger.addHandler(handler)
    logger.propagate = False
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.propagate = before


def _upright(values: np.ndarray, orientation: int) -> np.ndarray:
    """Return values (H, W, …) turned and mirrored as the orientation of Exif asks for."""
    if orientation >= 5:
        values = np.swapaxes(values, 0, 1)
    up = orientation in (3, 4, 7, 8)
    left = orientation in (2, 3, 6, 7)
    return values[:: -1 if up else 1, :: -1 if left else 1]
