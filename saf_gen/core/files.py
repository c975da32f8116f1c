"""Files and folders that are written whole or not at all.

What is not whole yet has a hidden name, ``.NAME.TOKEN.MACHINE.PID.part``, which tells what process writes it. Whoever
writes into a folder removes what processes that have ended left there.
"""

import errno
import fcntl
import os
import re
import secrets
import shutil
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from saf_gen.core.object_store import check_on_disk
from saf_gen.errors import BadInput

ABANDONED_S = 86_400.0
"""Seconds without a change after which a temporary file of another machine, whose processes are unknown, is removed."""
_TEMPORARY = re.compile(r"\.(?P<name>.+)\.[0-9a-f]{8}\.(?P<machine>[A-Za-z0-9-]+)\.(?P<pid>\d+)\.part")
LOCKING = "HDF5_USE_FILE_LOCKING"


@contextmanager
def write_atomically(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary file beside ``path`` to write to; at the end it is synced to disk and renamed.

    The folder is made where it is missing. On an exception the temporary file is removed and an older
    ``path`` stays. Several processes, on several machines, may write the same path: the last one wins, whole.

    Raises BadInput when the disk is full or the folder cannot be written.
    """
    final = Path(path)
    check_on_disk(final)
    part = temporary_file_name(final)
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
        _remove_leftovers_once(final.parent)
        yield part
        with part.open("rb") as written:
            os.fsync(written.fileno())
        rename_durably(part, final)
    except OSError as error:
        raise unwritable_file_error(final, error) from error
    finally:
        with suppress(OSError):  # removed already, or its folder is not a folder
            part.unlink(missing_ok=True)


def file_name_as_text(name: str) -> str:
    """Return the name of a file as text that files can hold: bytes that are no UTF-8 become escapes."""
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def write_text_atomically(path: str | os.PathLike[str], text: str) -> None:
    """Write a UTF-8 text file that is there whole or not at all; raises as :func:`write_atomically` does."""
    with write_atomically(path) as part:
        part.write_text(text, encoding="utf-8")


@contextmanager
def write_folder_atomically(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary folder beside ``path`` to fill; at the end it is renamed to ``path``, which is new or empty.

    Raises BadInput when the disk is full or a folder cannot be written.
    """
    final = Path(path)
    try:
        with temporary_folder(final) as part:
            yield part
            rename_durably(part, final)
    except OSError as error:
        raise unwritable_file_error(final, error) from error


@contextmanager
def temporary_folder(path: Path) -> Iterator[Path]:
    """Yield a new folder under a temporary name beside ``path``; it is removed at the end."""
    check_on_disk(path)
    part = temporary_file_name(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    remove_leftover_files(path.parent)
    part.mkdir()
    try:
        yield part
    finally:
        shutil.rmtree(part, ignore_errors=True)


def rename_durably(old: Path, new: Path) -> None:
    """Rename a file or a folder, in the place of an older file ``new``, so that it outlasts a crash of the machine."""
    old.replace(new)
    sync_folder(new.parent)


def sync_folder(folder: Path) -> None:
    """Write the names in a folder to disk, where its file system can."""
    with suppress(OSError):
        opened = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(opened)
        finally:
            os.close(opened)


def free_disk_bytes(folder: Path) -> int:
    """Return the bytes that are free where ``folder`` lies, or would be made."""
    return shutil.disk_usage(_nearest_existing(folder)).free


def _nearest_existing(folder: Path) -> Path:
    return next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())


def check_folder_writable(folder: Path) -> None:
    """Raise BadInput where ``folder`` could not be made or written to; nothing is made."""
    check_on_disk(folder)
    there = _nearest_existing(folder)
    if not there.is_dir():
        raise unwritable_file_error(folder, NotADirectoryError(errno.ENOTDIR, "", str(there)))
    if not os.access(there, os.W_OK):
        raise unwritable_file_error(folder, PermissionError(errno.EACCES, "", str(there)))


def check_file_system(folder: Path) -> None:
    """Raise BadInput where files in ``folder`` cannot be put in the place of others, synced or locked as HDF5 does.

    Some file systems over a network or an object store cannot; half-written files would be taken for whole. Two small
    files are written and removed.
    """
    new, old = temporary_file_name(folder / "new"), temporary_file_name(folder / "old")
    step = ""
    try:
        old.write_bytes(b"old")
        with new.open("wb") as file:
            file.write(b"new")
            file.flush()
            step = "sync files to the disk"
            os.fsync(file.fileno())
            step = "lock files"
            if os.environ.get(LOCKING, "").upper() not in ("FALSE", "BEST_EFFORT"):
                _lock_as_hdf5_does(file.fileno())
        step = "put a file in the place of another"
        new.replace(old)
        if old.read_bytes() != b"new":
            raise OSError(errno.EIO, "")
    except OSError as error:
        if not step:
            raise unwritable_file_error(folder, error) from error
        raise BadInput(
            f"the file system of {folder} cannot {step}: {os.strerror(error.errno or errno.EIO)}",
            allowed="one with atomic renaming, such as ext4, XFS, NFS, Lustre or BeeGFS",
            hint=f"set {LOCKING}=FALSE where one process alone writes a file" if step == "lock files" else "",
        ) from error
    finally:
        for path in (new, old):
            with suppress(OSError):
                path.unlink(missing_ok=True)


def _lock_as_hdf5_does(file: int) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno != errno.ENOSYS:  # where there are no locks at all HDF5 goes on without
            raise


def unwritable_file_error(path: Path, error: OSError) -> BadInput:
    """Return the error for a file that cannot be written; folders with a hidden name are told by their final one."""
    reason = os.strerror(error.errno) if error.errno else str(error)
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    hint = "free space and run the same command again: it goes on" if full else "choose another folder"
    names = (found["name"] if (found := _TEMPORARY.fullmatch(name)) else name for name in path.parts)
    return BadInput(f"{Path(*names)} cannot be written: {reason}", hint=hint)


def undeletable_file_error(path: Path, error: OSError) -> BadInput:
    """Return the error for a file, or something in a folder, that cannot be deleted."""
    reason = os.strerror(error.errno) if error.errno else str(error)
    return BadInput(f"{path}: nothing can be deleted there: {reason}", hint="change its permissions")


def remove_leftover_files(folder: Path, *, below: bool = False) -> None:
    """Remove the temporary files and folders in ``folder`` whose process has ended; with ``below`` in its folders too.

    Of those that another machine wrote the age decides.
    """
    for part in (folder.rglob if below else folder.glob)(".*.part"):
        with suppress(OSError):  # another process was quicker, or it belongs to another user
            if not _is_left_behind(part):
                continue
            if part.is_dir():
                shutil.rmtree(part, ignore_errors=True)
            else:
                part.unlink()


@cache
def _remove_leftovers_once(folder: Path) -> None:
    remove_leftover_files(folder)


def _is_left_behind(part: Path) -> bool:
    found = _TEMPORARY.fullmatch(part.name)
    if found is None:
        return False
    if found["machine"] != _machine():
        return time.time() - part.stat().st_mtime > ABANDONED_S
    return not _is_running(int(found["pid"]))


def temporary_file_name(final: Path) -> Path:
    """Return a new name beside ``final``, which says what process writes it; what is left there is removed later."""
    # The token keeps apart containers with equal names and processes, and shards that render the same stack.
    return final.with_name(f".{final.name}.{secrets.token_hex(4)}.{_machine()}.{os.getpid()}.part")


def _machine() -> str:
    """Return the name of this machine as part of a file name, with the number of the container's own processes."""
    try:
        namespace = f"-{Path('/proc/self/ns/pid').stat().st_ino:x}"  # processes of another one cannot be seen here
    except OSError:  # not Linux
        namespace = ""
    return re.sub(r"[^A-Za-z0-9-]", "-", socket.gethostname())[:40] + namespace


def _is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True  # the process of another user
    return True
