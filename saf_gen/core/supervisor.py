"""The supervisor of a child process: it starts the child, shuts it in, and ends it with everything that it started.

``python -I -S supervisor.py DESCRIPTOR`` reads its order, a line of JSON, from a socket. It adopts what the child
leaves behind, wherever that hides (sessions of its own, an empty environment), and kills all of it when the child ends,
or when the other end of the socket is closed, as by the death of the process that has it. Then it ends as the child
did.

It has one thread and uses the standard library alone, because Landlock holds for the thread that asks for it and what
that thread starts: the child is shut in before its Python begins.
"""

import ctypes
import json
import os
import select
import signal
import socket
import struct
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NoReturn

EXIT_NOT_STARTED = 112
"""Exit code for a child that the system does not start."""
CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
READ_FILE, READ_FOLDER = 1 << 0 | 1 << 2, 1 << 3  # to read is also to execute
OF_FILES = 1 << 0 | 1 << 1 | 1 << 2 | 1 << 14 | 1 << 15
"""Rights that a rule for a file, not a folder, may give: execute, write, read, truncate, control of devices."""
SUBREAPER, DEATH_SIGNAL, NO_NEW_PRIVILEGES, DROP_CAPABILITY = 36, 1, 38, 24
OVERRIDE_MODES = 1
"""The capability that root keeps, to read the files of a user who runs it in a container."""
PARENT_CHECK_MS = 2_000


def shut_in(readable: Sequence[str], *, listed: Sequence[str], writable: Sequence[str]) -> int:
    """Shut this thread, and what it starts, in these paths for good; return the version of Landlock, 0 without it.

    Parameters
    ----------
    readable : sequence of str
        Files, and folders with everything below, that may be read and executed.
    listed : sequence of str
        Folders of which only the names of what is in them, at any depth, may be read.
    writable : sequence of str
        Files and folders for any use.
    """
    if sys.platform != "linux":
        return 0
    libc = ctypes.CDLL(None, use_errno=True)
    version = libc.syscall(CREATE_RULESET, None, ctypes.c_size_t(0), 1)
    if version < 1:
        return 0
    every = (1 << {1: 13, 2: 14, 3: 15, 4: 15}.get(version, 16)) - 1
    size = 24 if version >= 6 else 16 if version >= 4 else 8
    # no TCP from version 4; no signals and no abstract sockets to processes outside from version 6
    handled = struct.pack("QQQ", every, 3, 3)[:size]
    ruleset = libc.syscall(CREATE_RULESET, handled, ctypes.c_size_t(size), 0)
    if ruleset < 0:
        return 0
    rules = ((readable, READ_FILE | READ_FOLDER), (listed, READ_FOLDER), (writable, every))
    for path, allowed in ((path, allowed) for paths, allowed in rules for path in paths):
        try:
            place = os.open(path, os.O_PATH | os.O_CLOEXEC | os.O_NOFOLLOW)
        except OSError:  # this machine has none
            continue
        is_folder = os.path.isdir(path)  # noqa: PTH112
        rule = struct.pack("=Qi", every & (allowed if is_folder else allowed & OF_FILES), place)
        libc.syscall(ADD_RULE, ruleset, 1, rule, 0)
        os.close(place)
    libc.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    for capability in set(range(64)) - {OVERRIDE_MODES}:  # root would otherwise read the environment of others
        libc.prctl(DROP_CAPABILITY, capability, 0, 0, 0)
    libc.capset(struct.pack("Ii", 0x20080522, 0), struct.pack("6I", 1 << OVERRIDE_MODES, 1 << OVERRIDE_MODES, *[0] * 4))
    return int(version) if libc.syscall(RESTRICT_SELF, ruleset, 0) == 0 else 0


def _become(order: dict[str, Any], line: socket.socket, *, supervisor: int) -> NoReturn:
    """Become the child, and send the version of Landlock that holds for it."""
    try:
        os.setsid()
        if sys.platform == "linux":
            ctypes.CDLL(None).prctl(DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
            if os.getppid() != supervisor:
                os._exit(EXIT_NOT_STARTED)
        if order["file_bytes"]:
            import resource

            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            with suppress(ValueError, OSError):  # there is a lower limit
                resource.setrlimit(resource.RLIMIT_FSIZE, (order["file_bytes"], order["file_bytes"]))
        reach = order["reach"]
        line.sendall(b"%d\n" % (0 if reach is None else shut_in(**reach)))
        os.execv(order["command"][0], order["command"])
    finally:
        os._exit(EXIT_NOT_STARTED)


def _end_all(child: int, *, is_running: bool) -> None:
    """Kill the child and all that it started; their own children become this process's, until there are none."""
    if is_running or sys.platform != "linux":  # where nothing is adopted, the child's group is all that is known
        with suppress(OSError):
            os.killpg(child, signal.SIGKILL)
            os.kill(child, signal.SIGKILL)
    while True:
        with suppress(OSError), open("/proc/thread-self/children") as file:  # noqa: PTH123
            for process in file.read().split():
                with suppress(OSError):
                    os.kill(int(process), signal.SIGKILL)
        try:
            os.waitpid(-1, 0)
        except ChildProcessError:
            return


def _delete(folder: str) -> None:
    """Delete a folder, however deep it is: what is in its folders is moved to its top before it is looked into."""
    moved = 0
    while inner := [entry for entry in os.scandir(folder) if entry.is_dir(follow_symlinks=False)]:
        for path in inner:
            os.chmod(path, 0o700)  # noqa: PTH101
            for entry in list(os.scandir(path)):
                if entry.is_dir(follow_symlinks=False):
                    os.chmod(entry, 0o700)  # noqa: PTH101
                    moved += 1
                    os.rename(entry, f"{folder}/.saf-gen-{moved}")  # noqa: PTH104
                else:
                    os.unlink(entry)  # noqa: PTH108
            os.rmdir(path)  # noqa: PTH106
    for entry in list(os.scandir(folder)):
        os.unlink(entry)  # noqa: PTH108
    os.rmdir(folder)  # noqa: PTH106


def main() -> NoReturn:
    """Run a child until it ends, or until the other end of the socket is gone."""
    line = socket.socket(fileno=int(sys.argv[1]))
    os.set_inheritable(line.fileno(), False)
    order, parent, supervisor = json.loads(line.makefile("rb").readline()), os.getppid(), os.getpid()
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(SUBREAPER, 1, 0, 0, 0)
    woken, wake = socket.socketpair()
    wake.setblocking(False)
    signal.set_wakeup_fd(wake.fileno(), warn_on_full_buffer=False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    try:
        child = os.fork()
    except OSError:
        os._exit(EXIT_NOT_STARTED)
    if not child:
        _become(order, line, supervisor=supervisor)
    nothing = os.open(os.devnull, os.O_RDWR)
    for file in (0, 1, *order["inherited"]):
        os.dup2(nothing, file)
    status, poll = None, select.poll()
    poll.register(line, select.POLLIN)
    poll.register(woken, select.POLLIN)
    while status is None and os.getppid() == parent:
        if any(file == line.fileno() for file, _ in poll.poll(PARENT_CHECK_MS)):
            break
        with suppress(BlockingIOError):
            woken.recv(4096, socket.MSG_DONTWAIT)
        with suppress(ChildProcessError):
            while (ended := os.waitpid(-1, os.WNOHANG))[0]:
                status = ended[1] if ended[0] == child else status
    _end_all(child, is_running=status is None)
    if order["folder"]:
        with suppress(OSError):
            _delete(order["folder"])
    if status is not None and os.WIFSIGNALED(status):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with suppress(OSError):
            signal.signal(os.WTERMSIG(status), signal.SIG_DFL)
        os.kill(os.getpid(), os.WTERMSIG(status))
    os._exit(os.waitstatus_to_exitcode(status) if status else 0)


if __name__ == "__main__":
    main()
