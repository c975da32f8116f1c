"""Time blocks of packed spikes: assembled and compressed for writing, decompressed and transposed for reading.

A chunk holds a band of rows, all columns and 250 bytes along time; the chunks of the same bytes form a time block.
Bytes in a chunk are ordered pixel by pixel, because this order compresses best. A time block in memory is transposed to
planes (bytes, H, W), in which a window of all pixels is contiguous. Chunks are processed on threads: isa-l and numpy
release Python's lock. :mod:`saf_gen.stream.time_blocks` keeps the most recently used time blocks of all streams.
"""

import itertools
import os
import weakref
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from math import prod
from threading import Lock
from typing import TypeVar

import numpy as np
from isal import igzip_lib, isal_zlib

from saf_gen.core.cores import usable_cores
from saf_gen.core.region import Region, region_shape
from saf_gen.errors import BadInput

# Memory and threads for the time blocks of all open streams in a process: one budget and one pool of threads.
#
# A forked process starts with an empty memory and new threads: threads do not survive a fork, and blocks that the
# parent's threads were about to fill would stay empty.


BUDGET_BYTES = 512 << 20
"""Maximum bytes of time blocks that a process keeps for all its open streams; three blocks are kept in any case."""

Block = tuple[np.ndarray, dict[int, Future]]
"""The planes of a time block, and the futures of its chunks whose filling has begun, by first row."""


def make_thread_pool(name: str, count: int | None = None) -> ThreadPoolExecutor:
    """Return a pool of ``count`` threads; by default one per core that this process may use, at most eight."""
    return ThreadPoolExecutor(count or min(8, usable_cores()), thread_name_prefix=name)


class BlockMemory:
    """Time blocks by stream and first byte; the least recently used are dropped first."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all time blocks and threads."""
        self._lock = Lock()
        self._pool: ThreadPoolExecutor | None = None
        self._blocks: OrderedDict[tuple[int, int], Block] = OrderedDict()
        self._forgotten: deque[int] = deque()

    @property
    def pool(self) -> ThreadPoolExecutor:
        """The threads that decompress for all streams."""
        with self._lock:
            self._pool = self._pool or make_thread_pool("inflate")
            return self._pool

    def find(self, stream: int, start: int, *, shape: tuple[int, int, int]) -> Block:
        """Return a time block of this shape (bytes, H, W), uint8, which may be empty or filled only in part.

        The two blocks that the stream used last are kept, because reading in order needs them in addition to the new
        one.
        """
        key = stream, start
        with self._lock:
            self._free_forgotten()
            if key not in self._blocks:
                self._blocks[key] = self._allocate(stream, shape), {}
            self._blocks.move_to_end(key)
            return self._blocks[key]

    def forget(self, stream: int) -> None:
        """Free the memory of a stream; if the lock is held, the next call of :meth:`find` frees it.

        Python's garbage collector may call this for an unused stream at any time, even on a thread that holds the lock.
        """
        self._forgotten.append(stream)
        if self._lock.acquire(blocking=False):
            try:
                self._free_forgotten()
            finally:
                self._lock.release()

    def _free_forgotten(self) -> None:
        while self._forgotten:
            stream = self._forgotten.popleft()
            for key in [key for key in self._blocks if key[0] == stream]:
                del self._blocks[key]

    def _allocate(self, stream: int, shape: tuple[int, int, int]) -> np.ndarray:
        used = sum(planes.nbytes for planes, _ in self._blocks.values()) + prod(shape)
        for key in self._oldest_without(stream) if used > BUDGET_BYTES else ():
            planes, filling = self._blocks.pop(key)
            used -= planes.nbytes
            if used <= BUDGET_BYTES and key[0] == stream and planes.shape == shape:
                wait(filling.values())
                return planes  # reuse the stream's memory, because fresh pages cost time
            if used <= BUDGET_BYTES:
                break
        return np.empty(shape, np.uint8)

    def _oldest_without(self, stream: int) -> list[tuple[int, int]]:
        """Return the keys of all blocks except the two that a stream used last, oldest first."""
        recent = [key for key in self._blocks if key[0] == stream][-2:]
        return [key for key in self._blocks if key not in recent]


BLOCK_MEMORY = BlockMemory()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=BLOCK_MEMORY.reset)


TIME_BLOCK_BYTES = 250
_CHUNK_BYTES = 1_000_000  # bytes in a chunk before compression: 10 rows of 400 columns

checksum = isal_zlib.crc32
Result = TypeVar("Result")


class DamagedChunk(ValueError):
    """Raised if stored bytes do not decompress to a chunk."""


def chunk_shape(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return the shape of a chunk of about 1 MB, with all columns, for packed spikes of ``shape`` (H, W, bytes)."""
    rows, columns, length = shape
    time_block = min(TIME_BLOCK_BYTES, length)
    return min(rows, max(1, _CHUNK_BYTES // (columns * time_block))), columns, time_block


def deflate_chunk(block: np.ndarray, chunk: tuple[int, int, int]) -> bytes:
    """Return ``block`` (rows, W, bytes), padded with zeros to the shape ``chunk`` and compressed."""
    if block.shape != chunk:
        padded = np.zeros(chunk, np.uint8)
        padded[: block.shape[0], :, : block.shape[2]] = block
        block = padded
    return isal_zlib.compress(np.ascontiguousarray(block), 1, isal_zlib.MAX_WBITS)


def inflate_chunk(data: bytes | np.ndarray, chunk: tuple[int, int, int]) -> np.ndarray:
    """Return a stored chunk as uint8 of the shape ``chunk``; an array is returned unchanged.

    Raises DamagedChunk if the bytes do not decompress to a chunk of this size or their checksum is wrong. At most one
    byte more than the size of a chunk is decompressed.
    """
    if isinstance(data, np.ndarray):
        return data
    size, inflater = chunk[0] * chunk[1] * chunk[2], isal_zlib.decompressobj(isal_zlib.MAX_WBITS)
    try:
        found = inflater.decompress(data, size + 1)  # one byte more, so that the checksum at the end is read
    except (igzip_lib.IsalError, ValueError) as error:  # type: ignore[misc]  # its stub declares an instance
        raise DamagedChunk(str(error)) from error
    if len(found) != size or not inflater.eof:
        raise DamagedChunk(f"a chunk does not hold {size:,} bytes")
    return np.frombuffer(found, np.uint8).reshape(chunk)


class TimeBlockAssembler:
    """Joins pieces of packed spikes, of any length, into the time blocks of a stream of ``shape`` (T, H, W).

    ``length`` is the number of bytes along time so far. A piece that is a complete time block is not copied.
    """

    def __init__(self, shape: tuple[int, int, int], *, where: str) -> None:
        self.length, self._frames, self._size, self._where = 0, shape[0], shape[1:], where
        self._total = -(-shape[0] // 8)
        self._time_block = min(TIME_BLOCK_BYTES, self._total)
        self._held = np.empty((0, 0, 0), np.uint8)

    def check_complete(self) -> None:
        """Raise BadInput unless all bytes have been added."""
        if self.length != self._total:
            raise BadInput(
                f"only {self.length} bytes along time were written",
                where=self._where,
                allowed=f"{self._total} for {self._frames} frames",
            )

    def _check(self, piece: np.ndarray) -> None:
        if piece.dtype != np.uint8 or piece.ndim != 3 or piece.shape[:2] != self._size:
            raise BadInput(
                f"packed spikes have dtype {piece.dtype} and shape {piece.shape}",
                where=self._where,
                allowed=f"uint8 ({self._size[0]}, {self._size[1]}, bytes)",
            )
        end, unused = self.length + piece.shape[2], self._frames % 8
        if end > self._total:
            raise BadInput(
                f"{end} bytes along time were written",
                where=self._where,
                allowed=f"{self._total} for {self._frames} frames",
            )
        if end == self._total and unused and piece.shape[2] and (piece[:, :, -1] >> unused).any():
            raise BadInput(
                "the last byte holds spikes after the last frame",
                where=self._where,
                allowed=f"0 in bits {unused} to 7, because T = {self._frames}",
            )

    def add(self, piece: np.ndarray) -> Iterator[np.ndarray]:
        """Yield each time block that ``piece``, uint8 (H, W, bytes), completes; the last of the stream may be shorter.

        Raises BadInput if the dtype or shape is wrong, or if there are too many bytes or spikes after the last frame.
        """
        self._check(piece)
        at = 0
        while at < piece.shape[2]:
            filled = self.length % self._time_block
            block_length = min(self._time_block, self._total - self.length + filled)
            part = piece[:, :, at : at + block_length - filled]
            at += part.shape[2]
            self.length += part.shape[2]
            if part.shape[2] == block_length:
                yield part
                continue
            if not self._held.size:
                self._held = np.empty((*self._size, self._time_block), np.uint8)
            self._held[:, :, filled : filled + part.shape[2]] = part
            if filled + part.shape[2] == block_length:
                yield self._held[:, :, :block_length]


class TimeBlocks:
    """Reads packed spikes and keeps the most recently used time blocks in memory.

    Parameters
    ----------
    shape : tuple of int
        (H, W, bytes) of the packed spikes.
    read : callable
        ``read(top, start)`` returns the chunk at that row and byte, as compressed bytes or as an array already cut to
        the edges. It is called only from the caller's thread.
    count : int, optional
        Number of threads that decompress for this object alone; by default it uses the threads that all streams share.
    """

    _numbers = itertools.count()

    def __init__(
        self, shape: tuple[int, int, int], *, read: Callable[[int, int], bytes | np.ndarray], count: int | None = None
    ) -> None:
        self.shape, self.chunk, self._read = shape, chunk_shape(shape), read
        self._last, self._number = -1, next(self._numbers)
        self._private_pool = make_thread_pool("inflate", count) if count else None
        self._forget = weakref.finalize(self, BLOCK_MEMORY.forget, self._number)

    @property
    def _pool(self) -> ThreadPoolExecutor:
        return self._private_pool or BLOCK_MEMORY.pool

    def close(self) -> None:
        """Stop the threads of this object and free its memory."""
        if self._private_pool:
            self._private_pool.shutdown(cancel_futures=True)
        self._forget()

    def split_frames(self, a: int, b: int) -> Iterator[tuple[int, int, int]]:
        """Yield, for each time block with frames ``a <= t < b``, its first byte and the first and stop bit to read."""
        time_block = 8 * self.chunk[2]
        for start in range(a // time_block * time_block, b, time_block):
            yield start // 8, max(a - start, 0), min(b - start, time_block)

    def map_chunks(self, start: int, rows: slice, *, work: Callable[[int, np.ndarray], Result]) -> Iterator[Result]:
        """Yield ``work(top, chunk)``, called on threads, for each chunk at byte ``start`` that overlaps ``rows``.

        The results come in the order of the rows. ``top`` is the first row of the chunk, which is uint8 (rows, W,
        bytes) and may extend beyond the last row and byte of the stream.
        """

        def run(top: int, data: bytes | np.ndarray) -> Result:
            return work(top, inflate_chunk(data, self.chunk))

        waiting = [self._pool.submit(run, top, self._read(top, start)) for top in self._tops(rows)]
        for future in waiting:
            yield future.result()

    def row_bands(self, start: int) -> Iterator[np.ndarray]:
        """Yield the time block at byte ``start`` as bands of rows, uint8 (rows, W, bytes) in C order."""
        rows, _, length = self.shape

        def band(top: int, chunk: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(chunk[: rows - top, :, : length - start])

        return self.map_chunks(start, slice(0, rows), work=band)

    def planes(self, start: int, rows: slice) -> np.ndarray:
        """Return the time block at byte ``start`` as uint8 (bytes, H, W); only ``rows`` are guaranteed to be filled."""
        planes, filling = self._time_block(start, rows)
        after = start + self.chunk[2]
        if start - self._last == self.chunk[2] and after < self.shape[2]:
            self._time_block(after, rows)  # blocks are read in order: decompress the next one while this one is used
        self._last = start
        for top in self._tops(rows):
            filling[top].result()
        return planes

    def packed(self, a: int, b: int, *, region: Region) -> np.ndarray:
        """Return bytes ``a <= i < b`` along time of a region, uint8 (h, w, b - a)."""
        out = np.empty((*region_shape(region), b - a), np.uint8)
        for start, first, stop in self.split_frames(8 * a, 8 * b):
            part = slice(first // 8, stop // 8)
            piece = out[:, :, start + part.start - a : start + part.stop - a]
            planes = self.planes(start, region[0])[part, region[0], region[1]]
            for y in range(out.shape[0]):  # row by row: the transpose of one row fits in the cache
                piece[y] = planes[:, y].T
        return out

    def _tops(self, rows: slice) -> range:
        return range(rows.start // self.chunk[0] * self.chunk[0], rows.stop, self.chunk[0])

    def _time_block(self, start: int, rows: slice) -> tuple[np.ndarray, dict[int, Future]]:
        planes, filling = BLOCK_MEMORY.find(self._number, start, shape=(self.chunk[2], *self.shape[:2]))

        def transpose(top: int, data: bytes | np.ndarray) -> None:
            block = inflate_chunk(data, self.chunk)[: self.shape[0] - top]
            planes[: block.shape[2], top : top + block.shape[0]] = block.transpose(2, 0, 1)

        for top in self._tops(rows):
            if top not in filling:
                filling[top] = self._pool.submit(transpose, top, self._read(top, start))
        return planes, filling
