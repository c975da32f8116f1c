"""Counts of many windows of a stream in one pass, and files of counts from which any window is read quickly.

A time block is always decompressed completely: it holds 20 windows of 100 frames, and counting one of them costs as
much as counting all. Here each chunk is added to the counts of all its windows while it is in the processor's cache,
and the counts are kept in a file.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from io import SEEK_END, BytesIO
from itertools import chain
from pathlib import Path

import numpy as np

from saf_gen.core import bits
from saf_gen.core.files import atomic_file
from saf_gen.core.region import Region, region_shape
from saf_gen.errors import BadInput
from saf_gen.stream.time_blocks import TimeBlocks, checksum

_CHECKSUM_BYTES = 4


def counts_dtype(window: int) -> np.dtype:
    """Return the smallest unsigned type that can hold the spikes of a pixel in ``window`` frames."""
    return np.min_scalar_type(window)


def count_windows(time_blocks: TimeBlocks, firsts: np.ndarray, *, window: int, region: Region) -> Iterator[np.ndarray]:
    """Yield the counts of all windows in order, several windows at a time, unsigned (n, h, w).

    Window k is the frames ``firsts[k] <= t < firsts[k] + window``. ``firsts``, int64, must be in ascending order;
    arguments are not checked.
    """
    begun = 0
    # Counts of the windows that have begun but not ended.
    counts = np.zeros((0, *region_shape(region)), counts_dtype(window))
    for start, low, high in time_blocks.split_frames(int(firsts[0]), int(firsts[-1]) + window):
        new = int(np.searchsorted(firsts, 8 * start + high)) - begun
        begun += new
        counts = np.concatenate([counts, np.zeros((new, *counts.shape[1:]), counts.dtype)])
        begins = firsts[begun - len(counts) : begun] - 8 * start
        if len(counts):
            lows, highs = np.maximum(begins, low), np.minimum(begins + window, high)
            add = partial(_add_chunk, counts=counts, region=region, firsts=lows, stops=highs)
            deque(time_blocks.map_chunks(start, region[0], work=add), maxlen=0)
        ended = int(np.searchsorted(begins + window, high, side="right"))
        if ended:
            yield counts[:ended]
            counts = counts[ended:]


def _add_chunk(
    top: int, chunk: np.ndarray, *, counts: np.ndarray, region: Region, firsts: np.ndarray, stops: np.ndarray
) -> None:
    rows, columns = region
    a, b = max(rows.start, top), min(rows.stop, top + len(chunk))
    out = counts[:, a - rows.start : b - rows.start]
    bits.sum_trains(chunk[a - top : b - top, columns], out, firsts=firsts, stops=stops)


@dataclass(frozen=True)
class KeptCounts:
    """Counts of windows in a .npy file, unsigned (windows, h, w), read one window at a time.

    The file is open only while it is read, so that thousands of them use neither file handles nor memory, in any number
    of processes. Behind the array, where numpy does not look, the file holds a checksum of each window, with which the
    window is compared whenever it is read. A CRC-32 takes a tenth of the time of reading, a SHA-256 three times of it.

    Attributes
    ----------
    path : Path
        The file.
    shape : tuple of int
        (windows, h, w).
    dtype : dtype
        Unsigned type of the counts.
    key : str
        What was counted; each checksum begins with it and with the number of the window, so that the counts of another
        recording or window do not pass.
    """

    path: Path
    shape: tuple[int, int, int]
    dtype: np.dtype
    key: str

    @cached_property
    def _header(self) -> bytes:
        header = BytesIO()
        what = {"descr": np.lib.format.dtype_to_descr(self.dtype), "fortran_order": False, "shape": self.shape}
        np.lib.format.write_array_header_1_0(header, what)
        return header.getvalue()

    @property
    def _window_bytes(self) -> int:
        return self.shape[1] * self.shape[2] * self.dtype.itemsize

    def is_there(self) -> bool:
        """Return whether the file exists with this header, and is as long as its header says."""
        with suppress(OSError), self.path.open("rb") as file:
            length = len(self._header) + self.shape[0] * (self._window_bytes + _CHECKSUM_BYTES)
            return file.read(len(self._header)) == self._header and file.seek(0, SEEK_END) == length
        return False

    def write(self, counts: Iterable[np.ndarray]) -> None:
        """Write counts that arrive in pieces (n, h, w), completely or not at all.

        Raises BadInput if the folder cannot be written.
        """
        checksums: list[bytes] = []
        with atomic_file(self.path) as part, part.open("wb") as file:
            file.write(self._header)
            for window in chain.from_iterable(counts):
                data = window.tobytes()
                checksums.append(self._checksum(len(checksums), data))
                file.write(data)
            file.write(b"".join(checksums))

    def read(self, number: int) -> np.ndarray:
        """Return the counts of one window, unsigned (h, w), read-only.

        Raises BadInput if they cannot be read, or are not those that were written.
        """
        try:
            with self.path.open("rb") as file:
                file.seek(len(self._header) + number * self._window_bytes)
                data = file.read(self._window_bytes)
                file.seek(len(self._header) + self.shape[0] * self._window_bytes + number * _CHECKSUM_BYTES)
                stored = file.read(_CHECKSUM_BYTES)
        except OSError as error:
            raise self._unusable(f"cannot be read: {error.strerror}") from error
        if stored != self._checksum(number, data):
            raise self._unusable("are not those that were counted: the file was changed or damaged")
        return np.frombuffer(data, self.dtype).reshape(self.shape[1:])

    def _checksum(self, number: int, data: bytes) -> bytes:
        return checksum(data, checksum(f"{self.key} {number}".encode())).to_bytes(_CHECKSUM_BYTES, "little")

    def _unusable(self, problem: str) -> BadInput:
        hint = "delete the file, and start again: the recording is then counted anew"
        return BadInput(f"the kept counts of windows {problem}", where=str(self.path), hint=hint)
