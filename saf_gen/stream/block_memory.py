"""Memory and threads for the time blocks of all open streams in a process: one budget and one pool of threads.

A forked process starts with an empty memory and new threads: threads do not survive a fork, and blocks that the
parent's threads were about to fill would stay empty.
"""

import os
from collections import OrderedDict, deque
from concurrent.futures import Future, ThreadPoolExecutor, wait
from math import prod
from threading import Lock

import numpy as np

from saf_gen.core.cores import usable_cores

BUDGET_BYTES = 512 << 20
"""Maximum bytes of time blocks that a process keeps for all its open streams; three blocks are kept in any case."""

Block = tuple[np.ndarray, dict[int, Future]]
"""The planes of a time block, and the futures of its chunks whose filling has begun, by first row."""


def make_stream_thread_pool(name: str, count: int | None = None) -> ThreadPoolExecutor:
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
            self._pool = self._pool or make_stream_thread_pool("inflate")
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
