"""OpenEXR files of named planes, float32 or float16, with text attributes; no other module calls OpenEXR."""

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

BLOCK = 8  # planes that are compressed together; to read one, its block must be read
MAX_FILE_BYTES = 1 << 40


def write_stack_planes(path: Path, planes: Mapping[str, np.ndarray], *, attributes: Mapping[str, str]) -> None:
    """Write planes (row, col) of one shape as channels of a scan-line image.

    Planes of float16 stay float16, all others become float32. The file is not compressed: ZIP would save 1 % of a
    render and take nine times as long, and single planes could no longer be read alone.
    """
    header: dict[str, object] = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage, **attributes}
    channels = {
        name: np.ascontiguousarray(plane, dtype=np.float16 if plane.dtype == np.float16 else np.float32)
        for name, plane in planes.items()
    }
    _write(OpenEXR.File(header, channels), path)


def write_stack_plane_blocks(
    path: Path, planes: Mapping[str, np.ndarray], *, attributes: Mapping[str, str], block_size: int = BLOCK
) -> None:
    """Write planes (row, col) of one shape and type, compressed without loss, in blocks that can be read separately.

    EXR's ZIP stores differences between neighbouring values, and neighbouring positions are more alike than
    neighbouring pixels: in this order, the planes of a focal stack take a seventh less space than as separate pictures.

    Parameters
    ----------
    path : Path
        File to write.
    planes : mapping of str to ndarray
        Planes by name; they are stored as float16 if all of them are float16, otherwise as float32.
    attributes : mapping of str to str
        Text attributes of the first part.
    block_size : int, default BLOCK
        Largest number of planes in a block.

    Notes
    -----
    Each part of the file holds a block, in the given order, as one picture in which the values of a pixel are adjacent:
    its columns are pixel · planes + plane. Its attribute ``planes`` names the planes. If the last block is not full,
    its last plane is repeated.
    """
    width = min(block_size, len(planes))
    stored = np.float16 if all(plane.dtype == np.float16 for plane in planes.values()) else np.float32
    parts = []
    extra: Mapping[str, str] = attributes  # in the first part only
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
    except RuntimeError as error:  # OpenEXR reports a full disk like this
        for number in (errno.ENOSPC, errno.EDQUOT):
            if os.strerror(number) in str(error):
                raise OSError(number, os.strerror(number)) from error
        raise OSError(str(error)) from error


def read_stack_planes(path: Path, names: Iterable[str] | None = None) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Return planes and text attributes, each by name, of a file of planes or of plane blocks.

    Parameters
    ----------
    path : Path
        File to read.
    names : iterable of str, optional
        Planes to read, by default all. Little else is read: only the blocks that hold these planes.

    Raises
    ------
    BadInput
        If the file is missing, truncated or not an EXR, or if a plane is missing.
    """
    try:
        check_plain_file(path, max_bytes=MAX_FILE_BYTES)
        if blocks := exr_parts.read_exr_part_headers(path, marked="planes"):
            return _read_blocks(path, blocks, names=names)
        header = exr_parts.read_exr_flat_header(path)
        rows = _rows(path, header)
        stored_names = header.line.names[2:] if header.line.names else ()
        planes = {name: np.array(rows[name]) for name in (stored_names if names is None else names)}
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
        raise BadInput(
            f"{path} is not a complete OpenEXR file: {error}", hint="delete it and run saf-gen generate again"
        ) from error
    return planes, header.texts


def _read_blocks(
    path: Path, blocks: list[exr_parts.PartHeader], *, names: Iterable[str] | None
) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    locations = {name: (part, column) for part in blocks for column, name in enumerate(part.texts["planes"].split())}
    width = len(blocks[0].texts["planes"].split())  # the first block is full
    pictures: dict[int, np.ndarray] = {}
    planes = {}
    for name in locations if names is None else names:
        part, column = locations[name]
        if part.number not in pictures:
            pictures[part.number] = exr_parts.read_exr_picture(path, part)
        planes[name] = pictures[part.number][:, column::width].copy()
    attributes = {key: text for key, text in blocks[0].texts.items() if key not in ("planes", "name", "type")}
    return planes, attributes


def _batches(names: Iterable[str], size: int) -> Iterator[list[str]]:
    """Yield the names in lists of ``size``; the last one may be shorter."""
    rest = iter(names)
    while block := list(islice(rest, size)):
        yield block


def _rows(path: Path, header: exr_parts.FlatHeader) -> np.ndarray:
    """Return the scan lines as a memory map: y, the number of bytes that follow, and a line of each channel.

    OpenEXR itself reads all channels of a line to return one. Without compression, all lines have one size and are at
    the end of the file, so they can be mapped.
    """
    line, count = header.line, header.count
    begin = path.stat().st_size - count * line.itemsize
    if begin <= 0:
        raise ValueError("it is truncated")
    rows = np.memmap(path, line, "r", begin, (count,))
    complete = (rows["bytes"] == line.itemsize - 8) & (rows["y"] == np.arange(header.first, header.first + count))
    if not complete.all():
        raise ValueError("its scan lines are not those of a complete, uncompressed file")
    return rows
