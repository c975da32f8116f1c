"""Memory and threads for the time blocks of all open streams of a process: one budget, one pool of threads.

A process that was forked starts with an empty memory and threads of its own: threads do not survive a fork, and what
its parent's were about to fill would stay empty.
"""

import os
from collections import OrderedDict, deque
from concurrent.futures import Future, ThreadPoolExecutor, wait
from math import prod
from threading import Lock

import numpy as np

from saf_gen.core.cores import usable_cores

BUDGET_BYTES = 512 << 20
"""Bytes of time blocks that a process keeps for all its open streams, and three time blocks at least."""

Block = tuple[np.ndarray, dict[int, Future]]
"""The planes of a time block, and by its first row each chunk that is being filled in or was."""


def make_stream_thread_pool(name: str, count: int | None = None) -> ThreadPoolExecutor:
    """Return a pool of ``count`` threads; by default one per core this process may use, eight at most."""
    return ThreadPoolExecutor(count or min(8, usable_cores()), thread_name_prefix=name)


class BlockMemory:
    """Time blocks by stream and first byte; the one that was used longest ago goes first."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything, the threads too."""
        self._lock = Lock()
        self._pool: ThreadPoolExecutor | None = None
        self._blocks: OrderedDict[tuple[int, int], Block] = OrderedDict()
        self._forgotten: deque[int] = deque()

    @property
    def pool(self) -> ThreadPoolExecutor:
        """The threads that inflate for all streams."""
        with self._lock:
            self._pool = self._pool or make_stream_thread_pool("inflate")
            return self._pool

    def find(self, stream: int, start: int, *, shape: tuple[int, int, int]) -> Block:
        """Return a time block of this shape, uint8 (bytes, H, W), as it was filled so far.

        The two blocks that the same stream used last stay: with the new one they are what a reader needs who goes on.
        """
        key = stream, start
        with self._lock:
            self._free_forgotten()
            if key not in self._blocks:
                self._blocks[key] = self._make_room(stream, shape), {}
            self._blocks.move_to_end(key)
            return self._blocks[key]

    def forget(self, stream: int) -> None:
        """Free the memory of a stream; where the memory is in use just now, when a block is looked for next.

        Python's garbage collector calls this for a lost stream at any moment, also from a thread that holds the lock.
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

    def _make_room(self, stream: int, shape: tuple[int, int, int]) -> np.ndarray:
        used = sum(planes.nbytes for planes, _ in self._blocks.values()) + prod(shape)
        for key in self._oldest_without(stream) if used > BUDGET_BYTES else ():
            planes, filling = self._blocks.pop(key)
            used -= planes.nbytes
            if used <= BUDGET_BYTES and key[0] == stream and planes.shape == shape:
                wait(filling.values())
                return planes  # memory of the same reader is used again: fresh pages cost time
            if used <= BUDGET_BYTES:
                break
        return np.empty(shape, np.uint8)

    def _oldest_without(self, stream: int) -> list[tuple[int, int]]:
        """Return the keys of all blocks but the two that a stream used last, oldest first."""
        own = [key for key in self._blocks if key[0] == stream][-2:]
        return [key for key in self._blocks if key not in own]


BLOCK_MEMORY = BlockMemory()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=BLOCK_MEMORY.reset)
