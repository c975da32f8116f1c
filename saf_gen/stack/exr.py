"""OpenEXR files of named planes, float32 or float16, with text attributes; nothing else calls OpenEXR."""

import errno
import os
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from saf_gen.core.config.document import check_plain_file
from saf_gen.errors import BadInput
from saf_gen.stack import exr_parts

BLOCK = 8  # planes that are compressed together; to read one is to read a block
MAX_FILE_BYTES = 1 << 40


def write_stack_planes(path: Path, planes: Mapping[str, np.ndarray], *, attributes: Mapping[str, str]) -> None:
    """Write planes (row, col) of one shape as channels of a scan-line image, as float16 or else float32.

    The file is not compressed: ZIP saves 1 % of a render and takes nine times as long, and single
    planes could no longer be read alone.
    """
    header: dict[str, object] = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage, **attributes}
    channels = {
        name: np.ascontiguousarray(plane, dtype=np.float16 if plane.dtype == np.float16 else np.float32)
        for name, plane in planes.items()
    }
    _write(OpenEXR.File(header, channels), path)


def write_stack_plane_blocks(
    path: Path, planes: Mapping[str, np.ndarray], *, attributes: Mapping[str, str], together: int = BLOCK
) -> None:
    """Write planes (row, col) of one shape and type, compressed without loss, that can still be read a few at a time.

    They are stored as float16 or else float32. Each part of the file holds a block of up to ``together`` planes, in
    the order given, as one picture in which the values of a pixel stand side by side: its columns are pixel · planes +
    plane. Its attribute ``planes`` names them; a last block that is not full repeats its last plane. ``attributes``
    are those of the first part. EXR's ZIP stores differences of neighbours, and neighbours in focus are more alike
    than neighbours on the sensor: planes of a focal stack take a seventh less than as pictures.
    """
    width = min(together, len(planes))
    stored = np.float16 if all(plane.dtype == np.float16 for plane in planes.values()) else np.float32
    parts = []
    extra: Mapping[str, str] = attributes  # in the first part alone
    for block in _batches(planes, width):
        pixels = [np.asarray(planes[name], dtype=stored) for name in block]
        pixels += [pixels[-1]] * (width - len(block))
        picture = np.stack(pixels, axis=-1).reshape(pixels[0].shape[0], -1)
        header: dict[str, object] = {
            **extra,
            "compression": OpenEXR.ZIP_COMPRESSION,
            "type": OpenEXR.scanlineimage,
            "planes": " ".join(block),
        }
        parts.append(OpenEXR.Part(header, {"Y": np.ascontiguousarray(picture)}, block[0]))
        extra = {}
    _write(OpenEXR.File(parts), path)


def _write(file: Any, path: Path) -> None:
    try:
        file.write(str(path))
    except RuntimeError as error:  # as OpenEXR tells of a full disk
        for number in (errno.ENOSPC, errno.EDQUOT):
            if os.strerror(number) in str(error):
                raise OSError(number, os.strerror(number)) from error
        raise OSError(str(error)) from error


def read_stack_planes(path: Path, names: Iterable[str] | None = None) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Return the planes and the text attributes, by name, of a file of planes or of plane blocks.

    With ``names`` only these planes are read, and little else of the file: of blocks, those that hold them.

    Raises BadInput for a file that is missing, truncated or not an EXR, and for a missing plane.
    """
    try:
        check_plain_file(path, most=MAX_FILE_BYTES)
        if blocks := exr_parts.read_exr_part_headers(path, marked="planes"):
            return _read_blocks(path, blocks, names=names)
        header = exr_parts.read_exr_flat_header(path)
        rows = _rows(path, header)
        held = header.line.names[2:] if header.line.names else ()
        planes = {name: np.array(rows[name]) for name in (held if names is None else names)}
    except (
        RuntimeError,
        OSError,
        ArithmeticError,
        LookupError,
        ValueError,
        TypeError,
        struct.error,
        zlib.error,
    ) as error:
        raise BadInput(f"{path} is not a whole OpenEXR file: {error}", hint="delete it, generate again") from error
    return planes, header.texts


def _read_blocks(
    path: Path, blocks: list[exr_parts.PartHeader], *, names: Iterable[str] | None
) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    places = {name: (part, place) for part in blocks for place, name in enumerate(part.texts["planes"].split())}
    width = len(blocks[0].texts["planes"].split())  # the first block is full
    pictures: dict[int, np.ndarray] = {}
    planes = {}
    for name in places if names is None else names:
        part, place = places[name]
        if part.number not in pictures:
            pictures[part.number] = exr_parts.read_exr_picture(path, part)
        planes[name] = pictures[part.number][:, place::width].copy()
    attributes = {key: text for key, text in blocks[0].texts.items() if key not in ("planes", "name", "type")}
    return planes, attributes


def _batches(names: Iterable[str], size: int) -> Iterator[list[str]]:
    """Yield the names in lists of ``size``, the last one perhaps shorter."""
    rest = iter(names)
    while block := list(islice(rest, size)):
        yield block


def _rows(path: Path, header: exr_parts.FlatHeader) -> np.ndarray:
    """Return the scan lines as a memory map: y, the number of bytes that follow, a line of each channel.

    OpenEXR itself reads all channels of a line to return one. Without compression all lines have one size and
    end the file, so they can be mapped.
    """
    line, count = header.line, header.count
    begin = path.stat().st_size - count * line.itemsize
    if begin <= 0:
        raise ValueError("it is truncated")
    rows = np.memmap(path, line, "r", begin, (count,))
    whole = (rows["bytes"] == line.itemsize - 8) & (rows["y"] == np.arange(header.first, header.first + count))
    if not whole.all():
        raise ValueError("its scan lines are not those of a whole, uncompressed file")
    return rows
