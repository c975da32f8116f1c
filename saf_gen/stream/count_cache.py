"""Counts of many windows of a stream in one pass, and files of counts from which any window is read quickly.

A time block is always decompressed completely: it holds 20 windows of 100 frames, and counting one of them costs as
much as counting all. Here each chunk is added to the counts of all its windows while it is in the processor's cache,
and the counts are kept in a file.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from saf_gen.core import bits
from saf_gen.core.files import atomic_file
from saf_gen.core.region import Region, region_shape
from saf_gen.stream.time_blocks import TimeBlocks


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
    of processes.
    """

    path: Path
    shape: tuple[int, int, int]
    dtype: np.dtype
    offset: int

    @classmethod
    def open(cls, path: Path) -> "KeptCounts":
        """Return the counts in a file; raise FileNotFoundError if it is missing, ValueError if it holds no array."""
        array = np.load(path, mmap_mode="r")
        return cls(path, array.shape, array.dtype, array.offset)

    def read(self, number: int) -> np.ndarray:
        """Return the counts of one window, unsigned (h, w)."""
        size = self.shape[1] * self.shape[2]
        offset = self.offset + number * size * self.dtype.itemsize
        return np.fromfile(self.path, self.dtype, size, offset=offset).reshape(self.shape[1:])


def keep_counts(
    path: Path, counts: Iterable[np.ndarray], *, shape: tuple[int, int, int], dtype: np.dtype
) -> KeptCounts:
    """Write counts that arrive in pieces (n, h, w) to a .npy file, completely or not at all, and return the file.

    Raises BadInput if the folder cannot be written.
    """
    with atomic_file(path) as part, part.open("wb") as file:
        header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(file, header)
        for piece in counts:
            file.write(np.ascontiguousarray(piece).data)
    return KeptCounts.open(path)
