"""Child processes: a line for messages to each, memory for arrays, and an end for all that it started.

A message is as long as its first four bytes say, and no longer than both ends allow. What it holds is a matter of those
who use the line: workers of this package exchange pickles, code of others JSON, because what it sends must never be
executed. Arrays are too large for a pipe: one end writes them into memory that both map, and says so.

The child of a POSIX system has a supervisor (:mod:`saf_gen.core.supervisor`), which ends the child with everything that
it started. On Windows only the child itself is ended.
"""

import json
import mmap
import os
import queue
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from time import perf_counter
from typing import IO, Any, NamedTuple, Self

import numpy as np

from saf_gen.core import supervisor

SUPERVISED = os.name == "posix"
SEND_S = 5.0
"""Time within which a child reads a message."""
END_S = 5.0
"""Time that a supervisor gets to end everything."""
EXIT_LOST = 113
"""Exit code of a child that has lost its line."""


class ChildLost(Exception):
    """Error for a child that has ended, does not read, or sent too much; it says so in words after "its process"."""


class Reach(NamedTuple):
    """What a child may use of the file system; see :func:`saf_gen.core.supervisor.shut_in`."""

    readable: Sequence[str]
    listed: Sequence[str]
    writable: Sequence[str]


class Child:
    """A process that runs a function of this package, in a session of its own.

    Parameters
    ----------
    program : str
        The function, as ``module:name``; it takes its end of the line by ``Line(max_bytes)``.
    max_bytes : int
        Size of the longest message from it.
    environment : dict of str to str, optional
        Its environment; by default that of this process.
    folder : Path, optional
        Folder of its own, which is deleted when it has ended; it begins in ``work`` in there.
    memory : SharedMemory, optional
        Memory that it inherits.
    file_bytes : int, default 0
        Size of the largest file that it may write; 0 is no limit.
    reach : Reach, optional
        What it may use of the file system, where the system has Landlock; by default everything.
    on_output : callable, optional
        Called with what it prints, bytes; by default that is printed where this process prints its errors.

    Raises
    ------
    OSError
        If the system does not start it.
    """

    def __init__(
        self,
        program: str,
        *,
        max_bytes: int,
        environment: dict[str, str] | None = None,
        folder: Path | None = None,
        memory: "SharedMemory | None" = None,
        file_bytes: int = 0,
        reach: Reach | None = None,
        on_output: Callable[[bytes], object] | None = None,
    ) -> None:
        self._max_bytes, self._folder, self._held, self._ended = max_bytes, folder, bytearray(), False
        module, _, name = program.partition(":")
        paths = [str(Path(path).absolute()) for path in sys.path]  # '' is the working folder
        code = f"import sys; sys.path[:] = {paths!r}; from {module} import {name}; {name}()"
        command = [sys.executable, "-P", "-c", code]
        inherited = [memory.descriptor] if memory is not None and memory.descriptor >= 0 else []
        self._life, end = None, -1
        if SUPERVISED:
            order = {"command": command, "inherited": inherited, "file_bytes": file_bytes}
            order |= {"reach": reach and reach._asdict(), "folder": folder and str(folder)}
            order_line = json.dumps(order).encode() + b"\n"
            self._life, theirs = socket.socketpair()
            end = above_streams(theirs.detach())
            command, inherited = [sys.executable, "-I", "-S", supervisor.__file__, str(end)], [*inherited, end]
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=None if on_output is None else subprocess.PIPE,
                cwd=None if folder is None else folder / "work",
                env=environment,
                pass_fds=inherited,
                start_new_session=True,
            )
        except BaseException:
            if self._life is not None:
                self._life.close()
            raise
        finally:
            if end >= 0:
                os.close(end)
        if self._life is not None:
            self._life.settimeout(SEND_S)
            with suppress(OSError):  # that it is gone is noticed when it is waited for
                self._life.sendall(order_line)
        self._sources: dict[int, Callable[[bytes], object]] = {self._outgoing.fileno(): self._held.extend}
        if on_output is not None:
            self._sources[self._process.stderr.fileno()] = on_output  # type: ignore[union-attr]
        if os.name == "nt":
            self._arrived: queue.Queue[tuple[int, bytes]] = queue.Queue(16)
            for source in self._sources:
                threading.Thread(target=self._listen, args=(source,), daemon=True).start()
        else:
            os.set_blocking(self._incoming.fileno(), False)
            self._poll = select.poll()  # select() refuses descriptors above 1023
            for source in self._sources:
                self._poll.register(source, select.POLLIN)

    @property
    def _incoming(self) -> IO[bytes]:
        return self._process.stdin  # type: ignore[return-value]

    @property
    def _outgoing(self) -> IO[bytes]:
        return self._process.stdout  # type: ignore[return-value]

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return self._process.poll() is None

    def landlock(self) -> int:
        """Return the version of Landlock that shuts the child in, 0 for none; to be asked once, when it has begun."""
        with suppress(OSError, ValueError):  # it was not started
            return 0 if self._life is None else int(self._life.recv(8))
        return 0

    def fileno(self) -> int:
        """Return the descriptor that can be read when there is something to receive."""
        return self._outgoing.fileno()

    def send(self, data: bytes, *, seconds: float = SEND_S) -> None:
        """Send a message; raises ChildLost if the child does not read it within this time, which Windows cannot limit.

        That the child has ended is no error here, but of the next :meth:`receive`.
        """
        data = len(data).to_bytes(4, "little") + data
        deadline = perf_counter() + seconds
        with suppress(OSError, ValueError):
            if os.name == "nt":
                self._incoming.write(data)
                self._incoming.flush()
                return
            file, poll = self._incoming.fileno(), select.poll()
            poll.register(file, select.POLLOUT)
            while data:
                if not poll.poll(max(deadline - perf_counter(), 0.0) * 1e3):
                    raise ChildLost("does not read the replies to its requests")
                data = data[os.write(file, data) :]

    def receive(self, seconds: float) -> bytes | None:
        """Return the next message, None if it is not there within this time; raises ChildLost if there will be none."""
        deadline = perf_counter() + seconds
        while True:
            size = int.from_bytes(self._held[:4], "little")
            if len(self._held) >= 4 and not 0 < size <= self._max_bytes:
                raise ChildLost(f"sent a message of {size} bytes")
            if len(self._held) >= 4 + size > 4:
                message = bytes(self._held[4 : 4 + size])
                del self._held[: 4 + size]
                return message
            alive, left = self.alive, deadline - perf_counter()  # asked before, so that its last messages are read
            if self._ended or not (self._read(max(left, 0.0)) or alive):  # what it left may hold the line open
                raise ChildLost(self._how_it_ended())
            if left <= 0:
                return None

    def _read(self, seconds: float) -> bool:
        """Read a part of what has come within this time, and return whether anything has."""
        if os.name == "nt":
            try:
                come = [self._arrived.get(timeout=seconds)]
            except queue.Empty:
                return False
        else:
            come = [(file, os.read(file, 1 << 16)) for file, _ in self._poll.poll(seconds * 1e3)]
        for file, data in come:
            self._sources[file](data)
            if not data:
                self._ended |= file == self.fileno()
                if os.name != "nt":
                    self._poll.unregister(file)
        return bool(come)

    def _listen(self, file: int) -> None:
        data = b"-"
        while data:
            try:
                data = os.read(file, 1 << 16)
            except OSError:
                data = b""
            self._arrived.put((file, data))

    def _how_it_ended(self) -> str:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(1.0)
        code = self._process.poll()
        if code in (None, EXIT_LOST):
            return "closed its line"
        if code == supervisor.EXIT_NOT_STARTED:
            return "cannot be started"
        if code >= 0:
            return f"ended with exit code {code}"
        name = {number.value: number.name for number in signal.Signals}.get(-code, "unknown")
        return f"was ended by signal {-code} ({name}{', as where memory runs out' if name == 'SIGKILL' else ''})"

    def resident_bytes(self) -> int:
        """Return the memory of the child and of all that it started, with the files in memory that they hold, in bytes.

        It is 0 where the system does not tell.
        """
        total, files, waiting = 0, dict[int, int](), _children(self._process.pid)
        while waiting:
            process = waiting.pop()
            waiting += _children(process)
            with suppress(OSError, ValueError):
                total += int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
                for file in Path(f"/proc/{process}/fd").iterdir():
                    if str(file.readlink()).startswith("/memfd:"):
                        status = file.stat()
                        files[status.st_ino] = status.st_blocks * 512
        return total + sum(files.values())

    def let_end(self) -> None:
        """Close the line to the child, at whose end it ends itself."""
        with suppress(OSError):
            self._incoming.close()

    def wait(self, seconds: float) -> bool:
        """Return whether the child has ended within this time."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
        return not self.alive

    def close(self) -> None:
        """End the child and everything that it started, and delete its folder; does nothing the second time."""
        if self._outgoing.closed:
            return
        if self._life is not None:
            self._life.close()
        if not (SUPERVISED and self.wait(END_S)):
            self._process.kill()
            self._process.wait()
        for _ in range(64):  # what it said last
            if not self._read(0.0):
                break
        for pipe in (self._incoming, self._outgoing, self._process.stderr):
            with suppress(OSError):
                if pipe is not None:
                    pipe.close()
        if self._folder is not None and not SUPERVISED:
            import shutil

            shutil.rmtree(self._folder, ignore_errors=True)


def _children(process: int) -> list[int]:
    """Return the processes that any thread of a process has started."""
    found: list[int] = []
    with suppress(OSError):
        for task in Path(f"/proc/{process}/task").iterdir():
            with suppress(OSError):
                found += map(int, (task / "children").read_text().split())
    return found


def wait_for_any(children: Sequence[Child], seconds: float) -> None:
    """Return when there is something to receive from one of these children, and after this time in any case."""
    if os.name == "nt":
        time.sleep(min(seconds, 0.02))
        return
    poll = select.poll()
    for child in children:
        poll.register(child.fileno(), select.POLLIN)
    poll.poll(seconds * 1e3)


class Line:
    """The child's end of its line, which code that it runs cannot use by mistake.

    What the child prints goes where its errors go.
    """

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes, self._owner, self._sending = max_bytes, os.getpid(), threading.RLock()
        self._incoming, self._outgoing = (
            os.fdopen(above_streams(os.dup(file)), mode) for file, mode in enumerate(("rb", "wb"))
        )
        nothing = os.open(os.devnull, os.O_RDWR)
        os.dup2(nothing, 0)
        try:
            os.dup2(2, 1)
        except OSError:  # this process has no stream for errors
            os.dup2(nothing, 1)
        os.close(nothing)

    def send(self, data: bytes) -> None:
        """Send a message; a copy of this process, made by code that forks, ends here, as does a child without line."""
        if os.getpid() != self._owner:
            os._exit(1)
        try:
            with self._sending:
                self._outgoing.write(len(data).to_bytes(4, "little") + data)
                self._outgoing.flush()
        except (OSError, ValueError):  # code of others has closed it
            os._exit(EXIT_LOST)

    def receive(self) -> bytes | None:
        """Return the next message, or None at the end."""
        try:
            size = int.from_bytes(self._incoming.read(4), "little")
            data = self._incoming.read(size) if size <= self._max_bytes else b""
        except (OSError, ValueError):
            os._exit(EXIT_LOST)
        return data or None


def above_streams(file: int) -> int:
    """Return another number for an open file, above those of the standard streams, and close this one."""
    if os.name == "nt":
        return file
    import fcntl

    other = fcntl.fcntl(file, fcntl.F_DUPFD_CLOEXEC, 3)
    os.close(file)
    return other


class SharedMemory:
    """Memory that a process writes and its child reads.

    On Linux it is an anonymous file that cannot be made shorter, since a child that did so would end its parent with a
    bus error; elsewhere it is a file in the child's folder.

    Attributes
    ----------
    descriptor : int
        Descriptor that a child inherits, or -1 if it opens ``path``.
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

            file = above_streams(os.memfd_create("saf-gen window", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING))
            fcntl.fcntl(file, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_SEAL)
            return cls(file, inherited=True)
        file, path = tempfile.mkstemp(prefix="window-", dir=folder)
        return cls(file, path=path)

    @classmethod
    def attach(cls, descriptor: int, path: str) -> Self:
        """Return the memory that the parent made, in the child."""
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
            if grow and os.fstat(self._file).st_size < size:  # a child may have made it longer
                os.ftruncate(self._file, size)
            if self._map is not None:
                self._map.close()
            self._map = mmap.mmap(self._file, size)
        return self._map

    def close(self) -> None:
        """Release the memory; does nothing the second time."""
        if self._map is not None:
            self._map.close()
        if self._file >= 0:
            os.close(self._file)
        self._map, self._file = None, -1
