"""Files that are written whole or not at all."""

import errno
import os
import re
import secrets
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from saf_gen.errors import BadInput


@contextmanager
def write_atomically(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary file beside ``path`` to write to; at the end it is synced to disk and renamed.

    The folder is made where it is missing. On an exception the temporary file is removed and an older
    ``path`` stays. Several processes, on several machines, may write the same path: the last one wins, whole.

    Raises BadInput when the disk is full or the folder cannot be written.
    """
    final = Path(path)
    # Containers on one volume may have the same process numbers, and shards may render the same stack.
    part = final.with_name(f".{final.name}.{secrets.token_hex(4)}{mark_of_process()}.part")
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
        yield part
        with part.open("rb") as written:
            os.fsync(written.fileno())
        part.replace(final)
    except OSError as error:
        raise unwritable_error(final, error) from error
    finally:
        with suppress(OSError):  # removed already, or its folder is not a folder
            part.unlink(missing_ok=True)


def write_text_atomically(path: str | os.PathLike[str], text: str) -> None:
    """Write a UTF-8 text file that is there whole or not at all; raises as :func:`write_atomically` does."""
    with write_atomically(path) as part:
        part.write_text(text, encoding="utf-8")


def check_writable(folder: Path) -> None:
    """Raise BadInput where ``folder`` could not be made or written to; nothing is made."""
    there = next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())
    if not there.is_dir():
        raise unwritable_error(folder, NotADirectoryError(errno.ENOTDIR, "", str(there)))
    if not os.access(there, os.W_OK):
        raise unwritable_error(folder, PermissionError(errno.EACCES, "", str(there)))


def unwritable_error(path: Path, error: OSError) -> BadInput:
    """Return the error for a file that cannot be written."""
    reason = os.strerror(error.errno) if error.errno else str(error)
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    hint = "free space and run the same command again: it goes on" if full else "choose another folder"
    return BadInput(f"{path} cannot be written: {reason}", hint=hint)


def undeletable_error(path: Path, error: OSError) -> BadInput:
    """Return the error for a file, or something in a folder, that cannot be deleted."""
    reason = os.strerror(error.errno) if error.errno else str(error)
    return BadInput(f"{path}: nothing can be deleted there: {reason}", hint="change its permissions")


def remove_stale_temporaries(folder: Path) -> None:
    """Remove the temporary files below ``folder`` whose process, on this machine, has ended.

    Those of other machines stay, since their processes are unknown here.
    """
    for part in folder.rglob(f".*.{_host()}.*.part"):
        if is_left_behind(part.name.removesuffix(".part")):
            part.unlink(missing_ok=True)


def mark_of_process() -> str:
    """Return the end of a temporary file's name, which says what writes it: ``.HOST.PID``."""
    return f".{_host()}.{os.getpid()}"


def is_left_behind(name: str) -> bool:
    """Return whether a name ends with :func:`mark_of_process` of a process of this machine that has ended."""
    _, host, pid = ("", "", *name.split("."))[-3:]
    return host == _host() and pid.isdecimal() and not _is_running(int(pid))


def _host() -> str:
    """Return the name of this machine, or container, as part of a file name."""
    return re.sub(r"[^A-Za-z0-9-]", "-", socket.gethostname())[:40]


def _is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True  # the process of another user
    return True
