"""The wire between the evaluator and a guest: messages through pipes, images and lens positions through shared memory.

A message is JSON, because what a guest sends must never be executed, and as long as its first four bytes say. Images
are too large for a pipe: the evaluator writes one into memory that both processes map, and then says so.
"""

import json
import os
import queue
import select
import threading
from time import perf_counter
from typing import Any, BinaryIO

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
