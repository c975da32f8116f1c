"""The wire between the evaluator and a guest: messages through pipes, images and lens positions through shared memory.

A message is JSON, because what a guest sends must never be executed, and as long as its first four bytes say. Images
are too large for a pipe: the evaluator writes one into memory that both processes map, and then says so.
"""

import json
import mmap
import os
import queue
import select
import sys
import tempfile
import threading
from pathlib import Path
from time import perf_counter
from typing import Any, BinaryIO, Self

import numpy as np

_to_json = json.JSONEncoder(separators=(",", ":")).encode  # json.dumps would make an encoder for each message
MAX_MESSAGE_BYTES = 8 << 20
"""Largest message, enough for a trace of the longest allowed length."""


def write_message(pipe: BinaryIO, message: dict[str, Any]) -> None:
    """Write a message; raises OSError if the other side is gone."""
    pipe.write(_pack(message))
    pipe.flush()


def _pack(message: dict[str, Any]) -> bytes:
    data = _to_json(message).encode()
    return len(data).to_bytes(4, "little") + data


def write_message_within(pipe: BinaryIO, message: dict[str, Any], *, seconds: float) -> bool:
    """Write a message to a process that may not read, and return whether it was written within this time.

    Where pipes cannot be waited for (Windows), it waits as long as it takes. Raises OSError if the other side is gone.
    """
    if os.name == "nt":
        write_message(pipe, message)
        return True
    data = _pack(message)
    deadline = perf_counter() + seconds
    while data:
        if not _is_ready(pipe.fileno(), select.POLLOUT, seconds=max(deadline - perf_counter(), 0.0)):
            return False
        data = data[os.write(pipe.fileno(), data[: select.PIPE_BUF]) :]  # a pipe that is ready takes as much
    return True


def _is_ready(file: int, event: int, *, seconds: float) -> bool:
    """Return whether a pipe can be read or written, or has ended, within this time."""
    poll = select.poll()  # select() refuses descriptors above 1023
    poll.register(file, event)
    return bool(poll.poll(seconds * 1e3))


def read_message(pipe: BinaryIO) -> dict[str, Any] | None:
    """Return the next message, or None at the end; raises ValueError if it is no message."""
    head = pipe.read(4)
    if len(head) < 4:
        return None
    size = _message_size(head)
    data = pipe.read(size)
    return _parse(data) if len(data) == size else None


def _message_size(head: bytes) -> int:
    if (size := int.from_bytes(head, "little")) > MAX_MESSAGE_BYTES:
        raise ValueError(f"a message of {size} bytes")
    return size


def _parse(data: bytes) -> dict[str, Any]:
    try:
        message = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise ValueError("a message that is not JSON") from error
    if not isinstance(message, dict):
        raise ValueError("a message that is not a JSON object")
    return message


class MessageReader:
    """Messages from a process that may stop anywhere: waiting for them has a limit.

    Where only sockets can be waited for (Windows), a thread waits for the pipe.
    """

    def __init__(self, pipe: BinaryIO) -> None:
        self._file, self._held = pipe.fileno(), b""
        self._arrived: queue.Queue[bytes] | None = None
        if os.name == "nt":
            self._arrived = queue.Queue()
            threading.Thread(target=self._listen, args=(self._arrived,), daemon=True).start()

    def wait(self, seconds: float) -> bool:
        """Return whether there is a whole message, or the end, within this time."""
        deadline = perf_counter() + seconds
        while not self._is_whole():
            left = max(deadline - perf_counter(), 0.0)
            if self._arrived is None:
                if not _is_ready(self._file, select.POLLIN, seconds=left):
                    return False
                read = os.read(self._file, 1 << 16)
            else:
                try:
                    read = self._arrived.get(timeout=left)
                except queue.Empty:
                    return False
            if not read:
                self._held = b""
                return True
            self._held += read
        return True

    def read(self) -> dict[str, Any] | None:
        """Return the message that was waited for, or None at the end; raises ValueError if it is no message."""
        if not self._held:
            return None
        size = 4 + _message_size(self._held[:4])
        data, self._held = self._held[4:size], self._held[size:]
        return _parse(data)

    def _is_whole(self) -> bool:
        if len(self._held) < 4:
            return False
        size = int.from_bytes(self._held[:4], "little")
        return size > MAX_MESSAGE_BYTES or len(self._held) >= 4 + size

    def _listen(self, arrived: "queue.Queue[bytes]") -> None:
        read = b"-"
        while read:
            try:
                read = os.read(self._file, 1 << 16)
            except OSError:
                read = b""
            arrived.put(read)


class SharedMemory:
    """Memory that the evaluator writes and a guest reads.

    On Linux it is an anonymous file that cannot be made shorter, since a guest that did so would end the evaluator with
    a bus error; elsewhere it is a file in the guest's folder.

    Attributes
    ----------
    descriptor : int
        Descriptor that a guest inherits, or -1 if it opens ``path``.
    path : str
        Path of the file, or ''.
    """

    def __init__(self, file: int, *, path: str = "", inherited: bool = False) -> None:
        self._file, self.path = file, path
        self.descriptor = file if inherited else -1
        self._map: mmap.mmap | None = None
        self._buffer = np.empty(0, np.uint8)
        self._unheld = sys.getrefcount(self._buffer)

    @classmethod
    def create(cls, folder: Path) -> Self:
        """Return memory of no size."""
        if hasattr(os, "memfd_create"):
            import fcntl

            made = os.memfd_create("saf-gen window", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
            file = fcntl.fcntl(made, fcntl.F_DUPFD_CLOEXEC, 3)  # a worker without standard streams has lower ones free
            os.close(made)
            fcntl.fcntl(file, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK)
            return cls(file, inherited=True)
        file, path = tempfile.mkstemp(prefix="window-", dir=folder)
        return cls(file, path=path)

    @classmethod
    def attach(cls, descriptor: int, path: str) -> Self:
        """Return the memory that the evaluator made, in the guest."""
        return cls(descriptor if descriptor >= 0 else os.open(path, os.O_RDWR))

    def write(self, image: np.ndarray) -> dict[str, Any]:
        """Write an array, and return the part of a message that tells :meth:`read` where it is."""
        if image.nbytes:
            self._mapped(image.nbytes, grow=True)[: image.nbytes] = np.ascontiguousarray(image).data.cast("B")
        return {"shape": list(image.shape), "dtype": image.dtype.str}

    def read(self, message: dict[str, Any]) -> np.ndarray:
        """Return a copy of the array of a message, read-only.

        A buffer that nobody holds any more is used again, because new memory costs more than the copy.
        """
        shape, dtype = tuple(message["shape"]), np.dtype(message["dtype"])
        size = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
        if self._buffer.nbytes != size or sys.getrefcount(self._buffer) > self._unheld:
            self._buffer = np.empty(size, np.uint8)
        if size:
            self._buffer[:] = np.frombuffer(self._mapped(size), np.uint8, size)
        image = self._buffer.view(dtype).reshape(shape)
        image.flags.writeable = False
        return image

    def _mapped(self, size: int, *, grow: bool = False) -> mmap.mmap:
        if self._map is None or len(self._map) < size:
            if grow:
                os.ftruncate(self._file, size)
            if self._map is not None:
                self._map.close()
            self._map = mmap.mmap(self._file, os.fstat(self._file).st_size)
        return self._map

    def close(self) -> None:
        """Release the memory."""
        if self._map is not None:
            self._map.close()
        os.close(self._file)
