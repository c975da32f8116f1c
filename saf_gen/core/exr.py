"""OpenEXR files: ours, of named planes with text attributes, and those of others; no other module calls OpenEXR."""

import errno
import os
import struct
import sys
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from fractions import Fraction
from io import StringIO
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
# table of offsets for each part, then chunks of 16 lines. ZIP is zlib's deflate of the bytes of a chunk, even bytes
# before odd ones, each stored as the difference from its predecessor.


MAGIC, TILED, DEEP, MULTI_PART = 20000630, 0x200, 0x800, 0x1000
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


# Files of others: we read the headers, and OpenEXR the pixels. A damaged header makes OpenEXR reserve memory, or
# compute, without end.

FLAT_KINDS = ("scanlineimage", "tiledimage")
HEAD_BYTES = (1 << 16, 1 << 20, 1 << 26)
"""Bytes that are read to find the headers, one after the other; a header may hold a large preview or manifest."""
MAX_CHANNEL_BYTES = 1 << 31
"""Largest size of all channels of a file in memory, because OpenEXR reads all of them."""
MAX_TILE = 1 << 14


@dataclass(frozen=True)
class ForeignPart:
    """Header of one part of a file of others.

    Attributes
    ----------
    number, count : int
        Index of the part in the file, and the number of its parts.
    name : str
        Its name; '' if it has none.
    kind : str
        One of FLAT_KINDS, or another type, such as ``deepscanline``, whose pixels cannot be read here.
    channels : dict of str to int
        Names of the channels, and the product of their sampling steps: 1 if every pixel has a value.
    data_window, display_window : tuple of int
        First column, first row, last column and last row of the pixels in the file, and of the picture.
    chromaticities : tuple of float or None
        CIE x and y of red, green, blue and white, if the file states them.
    rate_hz : Fraction or None
        Pictures per second of the sequence to which it belongs, if the file states them.
    """

    number: int
    count: int
    name: str
    kind: str
    channels: dict[str, int]
    data_window: tuple[int, int, int, int]
    display_window: tuple[int, int, int, int]
    chromaticities: tuple[float, ...] | None
    rate_hz: Fraction | None


def read_foreign_headers(path: Path, *, max_pixels: int) -> list[ForeignPart]:
    """Return the headers of all parts of an OpenEXR file.

    Raises BadInput if a header is damaged, or if a part has more than ``max_pixels`` pixels.
    """
    try:
        check_plain_file(path, max_bytes=MAX_FILE_BYTES)
        attributes, flags = _read_foreign_attributes(path)
        parts = [_foreign_part(one, n, flags=flags, count=len(attributes)) for n, one in enumerate(attributes)]
        tiles = [struct.unpack("<2IB", one["tiles"][1])[:2] if "tiles" in one else (1, 1) for one in attributes]
    except OSError as error:
        raise _unreadable(path, error.strerror or str(error)) from error
    except (LookupError, ValueError, ArithmeticError, struct.error) as error:
        raise _unreadable(path, "its header is damaged, or it is no OpenEXR file") from error
    total = 0
    for part, (wide, high) in zip(parts, tiles, strict=True):
        left, top, right, bottom = part.data_window
        columns, rows = right - left + 1, bottom - top + 1
        if not (columns > 0 and rows > 0 and columns * rows <= max_pixels):
            raise _unreadable(path, f"it has {columns} × {rows} pixels, and at most {max_pixels} are read")
        fits = 0 < wide <= MAX_TILE and 0 < high <= MAX_TILE
        # The table of a file has 8 bytes for each tile.
        if not fits or ("tile" in part.kind and 8 * -(-columns // wide) * -(-rows // high) > path.stat().st_size):
            raise _unreadable(path, f"it has tiles of {wide} × {high} pixels")
        total += 4 * columns * rows * len(part.channels)
    if total > MAX_CHANNEL_BYTES:
        raise _unreadable(path, f"its channels take {total} bytes, and at most {MAX_CHANNEL_BYTES} are read")
    return parts


def read_foreign_channels(path: Path, names: Sequence[str], *, part: ForeignPart) -> dict[str, np.ndarray]:
    """Return channels of a part by name, (row, col) of its data window, in the type that they have in the file.

    Raises BadInput if any part of the file is damaged or incomplete.
    """
    try:
        with _silence() as said:
            # OpenEXR leaves out a part that it cannot read, and prints why.
            parts = OpenEXR.File(str(path), separate_channels=True).parts
        if len(parts) != part.count:
            raise ValueError(said.getvalue().partition(" - ")[2] or "it is incomplete")
        channels = parts[part.number].channels
        return {name: np.asarray(channels[name].pixels) for name in names}
    except (RuntimeError, OSError, LookupError, ValueError, TypeError, MemoryError) as error:
        raise _unreadable(path, " ".join(str(error).split()) or "it does not fit the memory") from error


def _unreadable(path: Path, reason: str) -> BadInput:
    return BadInput(f"cannot be read: {reason}", where=str(path), allowed="a complete OpenEXR file")


def _read_foreign_attributes(path: Path) -> tuple[list[dict[str, tuple[str, bytes]]], int]:
    """Return the attributes of each part, and the flags of the file."""
    size = path.stat().st_size
    with path.open("rb") as file:
        for wanted in HEAD_BYTES:
            file.seek(0)
            head = file.read(wanted)
            try:
                attributes, _, _ = _read_attributes(head)
                return attributes, struct.unpack_from("<I", head, 4)[0]
            except (LookupError, ValueError, struct.error):  # perhaps there is more
                if wanted >= size or wanted == HEAD_BYTES[-1]:
                    raise
    raise ValueError("it has no header")


def _foreign_part(one: dict[str, tuple[str, bytes]], number: int, *, flags: int, count: int) -> ForeignPart:
    channels, listed, at = {}, one["channels"][1], 0
    while listed[at] != 0:
        end = listed.index(0, at)
        # A channel is name, type, linear, reserved, sampling in x and y; a zero byte ends the list.
        kind, _, across, down = struct.unpack_from("<i4s2i", listed, end + 1)
        if not (0 <= kind <= 2 and across > 0 and down > 0):
            raise ValueError("a channel is damaged")
        channels[listed[at:end].decode()] = across * down
        at = end + 1 + CHANNEL_BYTES
    left, top, right, bottom = struct.unpack("<4i", one["dataWindow"][1])
    shown = struct.unpack("<4i", one["displayWindow"][1])
    usual = "deep" if flags & DEEP else FLAT_KINDS[bool(flags & TILED)]
    colours = one.get("chromaticities", ("", b""))[1]
    rate = one.get("framesPerSecond", ("", b""))
    above, below = struct.unpack("<iI", rate[1]) if rate[0] == "rational" else (0, 1)
    texts = _texts({name: one[name] for name in ("name", "type") if name in one})
    return ForeignPart(
        number,
        count,
        texts.get("name", ""),
        texts.get("type", usual) if count > 1 else usual,
        channels,
        (left, top, right, bottom),
        shown,
        struct.unpack("<8f", colours) if colours else None,
        Fraction(above, below) if above > 0 and below > 0 else None,
    )


@contextmanager
def _silence() -> Iterator[StringIO]:
    """Yield what OpenEXR's wrapper prints; what its C library writes to the standard error is left out."""
    said = StringIO()
    if sys.stderr is None:  # a process without a terminal has no such file
        with redirect_stdout(said):
            yield said
        return
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        with redirect_stdout(said):
            yield said
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
