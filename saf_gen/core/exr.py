"""OpenEXR files of named planes, float32 or float16, with text attributes; no other module calls OpenEXR."""

import errno
import os
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import OpenEXR

from saf_gen.core.config.document import check_plain_file
from saf_gen.errors import BadInput

# Our own parser of OpenEXR files, because OpenEXR reads all parts or none, and damaged headers crash it.
#
# The layout is described in *OpenEXR File Layout*, https://openexr.com/en/latest/OpenEXRFileLayout.html: headers, a
# table
# of offsets for each part, then chunks of 16 lines. ZIP is zlib's deflate of the bytes of a chunk, even bytes before
# odd
# ones, each stored as the difference from its predecessor.


MAGIC, MULTI_PART = 20000630, 0x1000
UNCOMPRESSED, CHANNEL_BYTES = 0, 16
ZIP, LINES_PER_CHUNK = 3, 16
STORED = {1: "<f2", 2: "<f4"}
MAX_HEADER_BYTES = 1 << 20
MAX_DEFLATE_RATIO = 1100  # above the 1,032 bytes to which one byte of deflate expands at most


@dataclass(frozen=True)
class PartHeader:
    """Header of one part of a file.

    Attributes
    ----------
    number : int
        Index of the part in the file.
    texts : dict of str to str
        Text attributes by name.
    dtype : dtype
        Type of the values, little-endian float16 or float32.
    rows, columns : int
        Size of its picture.
    table : int
        Position in the file at which its table of chunk offsets begins.
    multi_part : bool
        Whether its chunks state which part they belong to, as in a file of several parts.
    """

    number: int
    texts: dict[str, str]
    dtype: np.dtype
    rows: int
    columns: int
    table: int
    multi_part: bool

    @property
    def chunks(self) -> int:
        return -(-self.rows // LINES_PER_CHUNK)


@dataclass(frozen=True)
class FlatHeader:
    """Header of a file of one uncompressed part.

    Attributes
    ----------
    line : dtype
        Type of a scan line: ``y``, ``bytes`` (number of bytes that follow), then each channel's columns by its name.
    first : int
        Number of the first scan line.
    count : int
        Number of scan lines.
    texts : dict of str to str
        Text attributes by name.
    """

    line: np.dtype
    first: int
    count: int
    texts: dict[str, str]


def read_flat_header(path: Path) -> FlatHeader:
    """Return the header of a file of one uncompressed part, as :func:`saf_gen.core.exr.write_planes` writes it.

    Raises OSError, ValueError, LookupError or struct.error for any other file.
    """
    with path.open("rb") as file:
        (one, *others), _, _ = _read_attributes(file.read(MAX_HEADER_BYTES))
    left, top, right, bottom = struct.unpack("<4i", one["dataWindow"][1])
    columns, listed, at = right - left + 1, one["channels"][1], 0
    if others or one["compression"][1] != bytes([UNCOMPRESSED]) or columns < 1 or bottom < top:
        raise ValueError("it is not one uncompressed picture")
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = [("y", "<i4"), ("bytes", "<i4")]
    while listed[at] != 0:
        end = listed.index(0, at)
        kind = STORED.get(struct.unpack_from("<i", listed, end + 1)[0])
        if kind is None:
            raise ValueError(f"channel {listed[at:end].decode()!r} holds no floats")
        fields.append((listed[at:end].decode(), kind, (columns,)))
        at = end + 1 + CHANNEL_BYTES
    return FlatHeader(np.dtype(fields), top, bottom - top + 1, _texts(one))


def read_part_headers(path: Path, *, marked: str) -> list[PartHeader]:
    """Return the headers of all parts; empty if the first part has no text attribute with the name ``marked``.

    Raises OSError, ValueError or struct.error if this is not a complete EXR file, and ValueError if a part of a file
    with that attribute is not a picture of one channel of floats with ZIP compression.
    """
    with path.open("rb") as file:
        found = _read_attributes(file.read(MAX_HEADER_BYTES))
    attributes, position, multi_part = found
    if marked not in _texts(attributes[0]):
        return []
    parts = []
    for number, one in enumerate(attributes):
        left, top, right, bottom = struct.unpack("<4i", one["dataWindow"][1])
        channel = one["channels"][1]
        name_end = channel.index(0)
        # A channel is name, type, linear, reserved, sampling in x and y; a zero byte ends the list.
        dtype = STORED.get(struct.unpack_from("<i", channel, name_end + 1)[0])
        if dtype is None or len(channel) != name_end + 18 or one["compression"][1] != bytes([ZIP]):
            raise ValueError(f"part {number} is not one channel of floats with ZIP compression")
        size = bottom - top + 1, right - left + 1
        part = PartHeader(number, _texts(one), np.dtype(dtype), *size, position, multi_part)
        position += 8 * part.chunks
        parts.append(part)
    return parts


def read_picture(path: Path, part: PartHeader) -> np.ndarray:
    """Return the picture of a part, (row, col), in the type of the part.

    Raises OSError, ValueError, struct.error or zlib.error if the file is damaged or truncated.
    """
    if part.dtype.itemsize * part.rows * part.columns > MAX_DEFLATE_RATIO * path.stat().st_size:
        raise ValueError("it is truncated, or its size is wrong")
    picture = np.empty((part.rows, part.columns), part.dtype)
    with path.open("rb") as file:
        file.seek(part.table)
        offsets = struct.unpack(f"<{part.chunks}Q", file.read(8 * part.chunks))
        for n, offset in enumerate(offsets):
            lines = picture[n * LINES_PER_CHUNK : (n + 1) * LINES_PER_CHUNK]
            lines[:] = _read_chunk(file, offset, part=part, size=lines.nbytes).view(part.dtype).reshape(lines.shape)
    return picture


def _read_chunk(file: BinaryIO, offset: int, *, part: PartHeader, size: int) -> np.ndarray:
    """Return the bytes of one chunk, uint8 (size,)."""
    file.seek(offset)
    if part.multi_part and struct.unpack("<i", file.read(4)) != (part.number,):
        raise ValueError(f"part {part.number} has a chunk of another part")
    _, packed_size = struct.unpack("<2i", file.read(8))
    packed = file.read(packed_size)
    if packed_size == size:  # a chunk that compression does not shrink is stored as it is
        return np.frombuffer(packed, np.uint8, size)
    steps = np.frombuffer(zlib.decompressobj().decompress(packed, size + 1), np.uint8)
    if steps.size != size:
        raise ValueError(f"part {part.number} has a chunk of {steps.size} bytes, not {size}")
    steps = steps.copy()
    steps[1:] -= 128
    np.add.accumulate(steps, out=steps)
    in_order = np.empty(size, np.uint8)
    in_order[0::2], in_order[1::2] = steps[: size // 2], steps[size // 2 :]
    return in_order


def _read_attributes(head: bytes) -> tuple[list[dict[str, tuple[str, bytes]]], int, bool]:
    """Return each part's attributes (type and value), where the headers end, and whether there may be several parts."""
    magic, version = struct.unpack_from("<2I", head)
    if magic != MAGIC:
        raise ValueError("its first bytes are wrong")
    multi_part = bool(version & MULTI_PART)
    parts: list[dict[str, tuple[str, bytes]]] = []
    position = 8
    while not (multi_part and parts and head[position] == 0):
        one = {}
        while head[position] != 0:
            name_end = head.index(0, position)
            type_end = head.index(0, name_end + 1)
            (size,) = struct.unpack_from("<i", head, type_end + 1)
            begin = type_end + 5
            if size < 0:  # reading would never end
                raise ValueError("it has an attribute of negative size")
            one[head[position:name_end].decode()] = head[name_end + 1 : type_end].decode(), head[begin : begin + size]
            position = begin + size
        position += 1
        parts.append(one)
        if not multi_part:
            break
    return parts, position + multi_part, multi_part


def _texts(attributes: dict[str, tuple[str, bytes]]) -> dict[str, str]:
    return {name: value.decode() for name, (kind, value) in attributes.items() if kind == "string"}


BLOCK = 8  # planes that are compressed together; to read one, its block must be read
MAX_FILE_BYTES = 1 << 40


def write_planes(path: Path, planes: Mapping[str, np.ndarray], *, attributes: Mapping[str, str]) -> None:
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


def write_plane_blocks(
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


def read_planes(path: Path, names: Iterable[str] | None = None) -> tuple[dict[str, np.ndarray], dict[str, str]]:
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
        if blocks := read_part_headers(path, marked="planes"):
            return _read_blocks(path, blocks, names=names)
        header = read_flat_header(path)
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
    path: Path, blocks: list[PartHeader], *, names: Iterable[str] | None
) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    locations = {name: (part, column) for part in blocks for column, name in enumerate(part.texts["planes"].split())}
    width = len(blocks[0].texts["planes"].split())  # the first block is full
    pictures: dict[int, np.ndarray] = {}
    planes = {}
    for name in locations if names is None else names:
        part, column = locations[name]
        if part.number not in pictures:
            pictures[part.number] = read_picture(path, part)
        planes[name] = pictures[part.number][:, column::width].copy()
    attributes = {key: text for key, text in blocks[0].texts.items() if key not in ("planes", "name", "type")}
    return planes, attributes


def _batches(names: Iterable[str], size: int) -> Iterator[list[str]]:
    """Yield the names in lists of ``size``; the last one may be shorter."""
    rest = iter(names)
    while block := list(islice(rest, size)):
        yield block


def _rows(path: Path, header: FlatHeader) -> np.ndarray:
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
