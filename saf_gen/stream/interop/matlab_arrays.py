"""Arrays of numbers in MATLAB files of version 5 to 7.2, listed and read a few slices at a time.

We use our own parser instead of scipy's, because these files come from untrusted sources and a damaged file can crash
scipy's with a segmentation fault. Nothing is decompressed beyond what is requested.

References
----------
MathWorks, "MAT-File Format", chapter "Level 5 MAT-Files".
"""

import zlib
from math import prod
from pathlib import Path
from typing import NamedTuple

import numpy as np

HEADER_BYTES, TAG_BYTES = 128, 8
HEAD_BYTES = 1 << 12
"""Bytes that are read from an array to find its name, shape and type; names have at most 63 letters."""
BLOCK_BYTES = 1 << 20
MAX_ARRAYS = 10_000
MATRIX, COMPRESSED = 14, 15
STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
COMPLEX, LOGICAL = 0x08, 0x02


class MatlabArray(NamedTuple):
    """The position and type of an array in a file.

    Attributes
    ----------
    dimensions : tuple of int
        Shape as in MATLAB, where the first dimension varies fastest.
    dtype : dtype
        Type of the values.
    stored : dtype
        Type in which the values are stored.
    begin : int
        Offset of the first value in the file or, if ``packed_at`` is not None, in the decompressed data.
    packed_at : int or None
        Offset in the file at which the compressed data begin; None if the array is not compressed.
    """

    dimensions: tuple[int, ...]
    dtype: np.dtype
    stored: np.dtype
    begin: int
    packed_at: int | None


def list_arrays(path: Path) -> dict[str, MatlabArray]:
    """Return the arrays of real numbers in a file by name.

    Raises ValueError or zlib.error if the file is damaged or of another version.
    """
    found: dict[str, MatlabArray] = {}
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(HEADER_BYTES)
        order = {b"IM": "<", b"MI": ">"}.get(header[126:])
        if order is None:
            raise ValueError("it is not a MATLAB file of version 5 to 7.3")
        at = HEADER_BYTES
        while at + TAG_BYTES <= size and len(found) < MAX_ARRAYS:
            file.seek(at)
            kind, count = (int(word) for word in np.frombuffer(file.read(TAG_BYTES), f"{order}u4"))
            if kind not in (MATRIX, COMPRESSED) or count < TAG_BYTES or at + TAG_BYTES + count > size:
                raise ValueError(f"the data at byte {at:,} are not a complete array")
            head, packed_at, available = file.read(min(HEAD_BYTES, count)), None, count
            begin = at + TAG_BYTES
            if kind == COMPRESSED:
                head, packed_at = zlib.decompressobj().decompress(head, HEAD_BYTES), begin
                kind, available = (int(word) for word in np.frombuffer(head[:TAG_BYTES], f"{order}u4"))
                head, begin = head[TAG_BYTES:], TAG_BYTES
            if kind == MATRIX and (
                named := _read_head(head, order, available=available, begin=begin, packed_at=packed_at)
            ):
                found[named[0]] = named[1]
            at += TAG_BYTES + count
    return found


def _read_head(
    head: bytes, order: str, *, available: int, begin: int, packed_at: int | None
) -> tuple[str, MatlabArray] | None:
    """Return the name and position of the array that begins with ``head``; None if its values are not real numbers."""
    (flags, _), at = _read_element(head, 0, order=order)
    kind, flag = int(flags[0]) & 0xFF, int(flags[0]) >> 8 & 0xFF
    if kind not in CLASSES or flag & COMPLEX:
        return None
    (dimensions, _), at = _read_element(head, at, order=order)
    (letters, _), at = _read_element(head, at, order=order)
    (_, stored), at = _read_element(head, at, order=order, with_values=False)
    shape = tuple(int(size) for size in dimensions)
    count = prod(shape) * stored.itemsize
    if min(shape) < 1 or at + count > available:
        raise ValueError(f"an array of the shape {shape} is not as long as its header says")
    dtype = np.dtype(bool if flag & LOGICAL else CLASSES[kind])
    name = letters.tobytes().decode("ascii", "replace")
    return name, MatlabArray(shape, dtype, stored, begin + at, packed_at)


def _read_element(
    head: bytes, at: int, *, order: str, with_values: bool = True
) -> tuple[tuple[np.ndarray, np.dtype], int]:
    """Return the values of an element with their type, and the offset of the next element.

    If ``with_values`` is False, no values are read, and the offset is where they begin.
    """
    words = np.frombuffer(head[at : at + TAG_BYTES], f"{order}u4")
    if words.size != 2:
        raise ValueError("an array is truncated")
    first, count = int(words[0]), int(words[1])
    small = first >> 16  # values of up to four bytes are stored in place of their byte count
    kind, count, begin = (first & 0xFFFF, small, at + 4) if small else (first, count, at + TAG_BYTES)
    if kind not in STORED:
        raise ValueError(f"an array holds values of the unknown type {kind}")
    stored = np.dtype(order + STORED[kind])
    if not with_values:
        return (np.empty(0, stored), stored), begin
    raw = head[begin : begin + count]
    if not raw or len(raw) < count or count % stored.itemsize:
        raise ValueError("the header of an array is truncated")
    return (np.frombuffer(raw, stored), stored), at + TAG_BYTES if small else begin + -(-count // 8) * 8


class MatlabSlices:
    """An array of a MATLAB file with its last axis first, (T, H, W), because MATLAB stores frame after frame.

    Attributes
    ----------
    shape : tuple of int
        (T, H, W).
    dtype : dtype
        Type of the values.
    """

    def __init__(self, path: Path, array: MatlabArray) -> None:
        *rest, last = array.dimensions
        self.shape: tuple[int, ...] = (last, *rest)
        self.dtype = array.dtype
        self._path, self._array = path, array
        self._restart()

    def __getitem__(self, span: slice) -> np.ndarray:
        """Return slices along the first axis; raise ValueError or zlib.error if the file is damaged."""
        first, stop, _ = span.indices(self.shape[0])
        size = prod(self.shape[1:]) * self._array.stored.itemsize
        raw = self._read(self._array.begin + first * size, max(stop - first, 0) * size)
        values = np.frombuffer(raw, self._array.stored).reshape(-1, *reversed(self.shape[1:]))
        return values.transpose(0, *range(values.ndim - 1, 0, -1)).astype(self.dtype)

    def _read(self, begin: int, count: int) -> bytes:
        if self._array.packed_at is None:
            with self._path.open("rb") as file:
                file.seek(begin)
                raw = file.read(count)
        else:
            if begin < self._at:
                self._restart()
            while self._at < begin:
                if not self._inflate(min(begin - self._at, BLOCK_BYTES)):
                    break
            raw = b"".join(iter(lambda: self._inflate(begin + count - self._at), b""))
        if len(raw) != count:
            raise ValueError("the array is shorter than its header says")
        return raw

    def _restart(self) -> None:
        self._at, self._packed_at, self._inflater = 0, self._array.packed_at or 0, zlib.decompressobj()

    def _inflate(self, max_bytes: int) -> bytes:
        """Return the next decompressed bytes, at most ``max_bytes``; b"" at the end."""
        found = b""
        while max_bytes > 0 and not found and not self._inflater.eof:
            if not (packed := self._inflater.unconsumed_tail):
                with self._path.open("rb") as file:
                    file.seek(self._packed_at)
                    packed = file.read(BLOCK_BYTES)
                self._packed_at += len(packed)
                if not packed:
                    break
            found = self._inflater.decompress(packed, max_bytes)
        self._at += len(found)
        return found
