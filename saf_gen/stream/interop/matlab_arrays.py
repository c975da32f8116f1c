"""Arrays of numbers in MATLAB files of version 5 to 7.2, listed and read a few slices at a time.

Lines of our own rather than scipy's reader: a damaged file can end that with a segmentation fault, and these files are
strangers'. Nothing is inflated beyond what is asked for.

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
"""What is read of an array to learn its name, shape and kind; names have at most 63 letters."""
BLOCK_BYTES = 1 << 20
MAX_ARRAYS = 10_000
MATRIX, COMPRESSED = 14, 15
STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
COMPLEX, LOGICAL = 0x08, 0x02


class MatlabArray(NamedTuple):
    """Where an array lies in a file.

    dimensions : as in MATLAB, the first varies fastest. dtype : of its values; stored : of its values as stored.
    begin : of its values, in the file, or in what is inflated from ``packed_at`` on, where that is not None.
    """

    dimensions: tuple[int, ...]
    dtype: np.dtype
    stored: np.dtype
    begin: int
    packed_at: int | None


def list_imported_arrays(path: Path) -> dict[str, MatlabArray]:
    """Return the arrays of real numbers in a file by name.

    Raises ValueError or zlib.error for a file that is damaged, or none of these versions.
    """
    found: dict[str, MatlabArray] = {}
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(HEADER_BYTES)
        order = {b"IM": "<", b"MI": ">"}.get(header[126:])
        if order is None:
            raise ValueError("it is no MATLAB file of version 5 to 7.3")
        at = HEADER_BYTES
        while at + TAG_BYTES <= size and len(found) < MAX_ARRAYS:
            file.seek(at)
            kind, count = (int(word) for word in np.frombuffer(file.read(TAG_BYTES), f"{order}u4"))
            if kind not in (MATRIX, COMPRESSED) or count < TAG_BYTES or at + TAG_BYTES + count > size:
                raise ValueError(f"what stands at byte {at:,} is no whole array")
            head, packed_at, room = file.read(min(HEAD_BYTES, count)), None, count
            begin = at + TAG_BYTES
            if kind == COMPRESSED:
                head, packed_at = zlib.decompressobj().decompress(head, HEAD_BYTES), begin
                kind, room = (int(word) for word in np.frombuffer(head[:TAG_BYTES], f"{order}u4"))
                head, begin = head[TAG_BYTES:], TAG_BYTES
            if kind == MATRIX and (named := _read_head(head, order, room=room, begin=begin, packed_at=packed_at)):
                found[named[0]] = named[1]
            at += TAG_BYTES + count
    return found


def _read_head(
    head: bytes, order: str, *, room: int, begin: int, packed_at: int | None
) -> tuple[str, MatlabArray] | None:
    """Return name and place of the array that begins so; None for text, structures and complex numbers."""
    (flags, _), at = _read_element(head, 0, order=order)
    kind, flag = int(flags[0]) & 0xFF, int(flags[0]) >> 8 & 0xFF
    if kind not in CLASSES or flag & COMPLEX:
        return None
    (dimensions, _), at = _read_element(head, at, order=order)
    (letters, _), at = _read_element(head, at, order=order)
    (_, stored), at = _read_element(head, at, order=order, whole=False)
    shape = tuple(int(size) for size in dimensions)
    count = prod(shape) * stored.itemsize
    if min(shape) < 1 or at + count > room:
        raise ValueError(f"an array of the shape {shape} is not as long as its header says")
    dtype = np.dtype(bool if flag & LOGICAL else CLASSES[kind])
    name = letters.tobytes().decode("ascii", "replace")
    return name, MatlabArray(shape, dtype, stored, begin + at, packed_at)


def _read_element(head: bytes, at: int, *, order: str, whole: bool = True) -> tuple[tuple[np.ndarray, np.dtype], int]:
    """Return the values of an element and their type, and where the next begins; without ``whole``, where they do."""
    words = np.frombuffer(head[at : at + TAG_BYTES], f"{order}u4")
    if words.size != 2:
        raise ValueError("an array is truncated")
    first, count = int(words[0]), int(words[1])
    small = first >> 16  # up to four bytes stand in the place of their count
    kind, count, begin = (first & 0xFFFF, small, at + 4) if small else (first, count, at + TAG_BYTES)
    if kind not in STORED:
        raise ValueError(f"an array holds values of the unknown type {kind}")
    stored = np.dtype(order + STORED[kind])
    if not whole:
        return (np.empty(0, stored), stored), begin
    raw = head[begin : begin + count]
    if not raw or len(raw) < count or count % stored.itemsize:
        raise ValueError("the header of an array is truncated")
    return (np.frombuffer(raw, stored), stored), at + TAG_BYTES if small else begin + -(-count // 8) * 8


class MatlabSlices:
    """An array of a MATLAB file, its last axis first, (T, H, W): MATLAB keeps frames last, and each in one piece.

    Attributes
    ----------
    shape : (T, H, W); dtype : of the values.
    """

    def __init__(self, path: Path, array: MatlabArray) -> None:
        *rest, last = array.dimensions
        self.shape: tuple[int, ...] = (last, *rest)
        self.dtype = array.dtype
        self._path, self._array = path, array
        self._restart()

    def __getitem__(self, span: slice) -> np.ndarray:
        """Return slices along the first axis; raises ValueError or zlib.error where the file is damaged."""
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
            raise ValueError("the array ends before its header says")
        return raw

    def _restart(self) -> None:
        self._at, self._packed_at, self._inflater = 0, self._array.packed_at or 0, zlib.decompressobj()

    def _inflate(self, most: int) -> bytes:
        """Return the next bytes, at most so many; b"" at the end."""
        found = b""
        while most > 0 and not found and not self._inflater.eof:
            if not (packed := self._inflater.unconsumed_tail):
                with self._path.open("rb") as file:
                    file.seek(self._packed_at)
                    packed = file.read(BLOCK_BYTES)
                self._packed_at += len(packed)
                if not packed:
                    break
            found = self._inflater.decompress(packed, most)
        self._at += len(found)
        return found
