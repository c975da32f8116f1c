"""Files and folders that are written completely or not at all.

An unfinished file or folder has a hidden name, ``.NAME.TOKEN.MACHINE.PID.part``, which identifies the process that
writes it. Before a process writes to a folder, it removes the unfinished files that ended processes have left there.
"""

import errno
import os
import re
import secrets
import shutil
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import file_digest
from pathlib import Path

from saf_gen.errors import BadInput

try:
    import fcntl
except ImportError:  # Windows
    HAS_LOCKS = False
else:
    HAS_LOCKS = True

ABANDONED_S = 86_400.0
"""Seconds without a change after which a temporary file of another machine, whose processes are unknown, is removed."""
_TEMPORARY = re.compile(r"\.(?P<name>.+)\.[0-9a-f]{8}\.(?P<machine>[A-Za-z0-9-]+)\.(?P<pid>\d+)\.part")
_ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+:/.*", re.DOTALL)
LOCKING = "HDF5_USE_FILE_LOCKING"
HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
"""The first bytes of an HDF5 file."""


@contextmanager
def atomic_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield the path of a temporary file next to ``path``, which is synced to disk and renamed to ``path`` at the end.

    A missing folder is created. If an exception is raised, the temporary file is removed and an older ``path`` remains.
    Several processes, even on several machines, may write the same path: the file that is completed last remains.

    Raises BadInput if the disk is full or the folder cannot be written to, or if ``path`` is a symbolic link.
    """
    final = Path(path)
    check_on_disk(final)
    refuse_link(final)
    part = temporary_name(final)
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
        _remove_leftovers_once(final.parent)
        yield part
        with part.open("r+b") as written:  # Windows syncs only what is open for writing
            os.fsync(written.fileno())
        rename_durably(part, final)
    except OSError as error:
        raise unwritable(final, error) from error
    finally:
        with suppress(OSError):  # it is already removed, or its parent is not a folder
            part.unlink(missing_ok=True)


def check_on_disk(path: Path) -> None:
    """Raise BadInput for an address such as ``s3://bucket/name``: it would be a path in a folder called ``s3:``."""
    if _ADDRESS.fullmatch(str(path)) and not Path(path.parts[0]).exists():
        scheme, _, rest = str(path).partition(":/")
        raise BadInput(
            f"{scheme}://{rest} is an address",
            allowed="a path on a disk",
            hint="get a published dataset with saf-gen fetch, and copy from and to other stores with their own tools",
        )


def name_as_text(name: str) -> str:
    """Return a file name as text that can be written to a file: bytes that are not UTF-8 become escapes."""
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def refuse_link(path: str | os.PathLike[str]) -> None:
    """Raise BadInput if an output is a symbolic link: replacing it would leave what it points to as it was."""
    if os.path.islink(path):  # noqa: PTH114  which also finds links that end in a slash
        target = Path(os.fspath(path).rstrip("/")).resolve()
        raise BadInput(f"{path} is a symbolic link", allowed="a file or folder itself", hint=f"write to {target}")


def check_ours(path: Path, mark: str) -> None:
    """Raise BadInput if an output would replace a link, a folder, or a file without this mark in its first 64 KiB."""
    refuse_link(path)
    if path.exists() and mark not in read_start(path):
        raise BadInput(f"{path} exists, and saf-gen did not write it", hint="choose another name, or move it away")


def read_start(path: Path) -> str:
    """Return the first 64 KiB of a file as text; '' if it is no file or cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(1 << 16).decode("utf-8", "replace")
    except OSError:
        return ""


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Create a folder if it is missing, and keep other processes that call this function from it during the block.

    A process that ends, however, holds no lock any more. Windows, and some file systems on a network, have no locks of
    this kind; the block then runs without one. If nothing was written into a new folder, it is removed again.

    Raises BadInput if another process holds the lock, or if the folder cannot be created.
    """
    is_new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        opened = os.open(folder, os.O_RDONLY) if HAS_LOCKS else None  # Windows opens no folders
    except OSError as error:
        raise unwritable(folder, error) from error
    try:
        try:
            _lock(opened)
        except OSError as error:
            if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
                hint = "wait until it has ended, or give another folder with --out"
                raise BadInput(f"another saf-gen is writing to {folder}", hint=hint) from error
        yield
    finally:
        if opened is not None:
            os.close(opened)
        if is_new:
            with suppress(OSError):  # it holds what the block wrote
                folder.rmdir()


def _lock(opened: int | None) -> None:
    """Lock an open file or folder, or raise OSError; nothing is locked where there are no locks of this kind."""
    if HAS_LOCKS and opened is not None:
        fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)


def check_apart(source: str | os.PathLike[str], out: str | os.PathLike[str]) -> None:
    """Raise BadInput if ``out`` is the file ``source``, which is read while ``out`` is written."""
    old, new = Path(source), Path(out)
    if old.exists() and new.exists() and new.samefile(old):
        raise BadInput("would be written over itself", where=str(source), hint="choose another output file")


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a file; raise BadInput if it cannot be read."""
    try:
        with path.open("rb") as file:
            return file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise BadInput(f"cannot be read: {error.strerror}", where=str(path)) from error


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a UTF-8 text file completely or not at all; raise BadInput as :func:`atomic_file` does."""
    with atomic_file(path) as part:
        part.write_text(text, encoding="utf-8")


@contextmanager
def temporary_folder(path: Path) -> Iterator[Path]:
    """Yield a new folder with a temporary name next to ``path``; it is removed at the end."""
    check_on_disk(path)
    refuse_link(path)
    part = temporary_name(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    remove_leftovers(path.parent)
    part.mkdir()
    try:
        yield part
    finally:
        shutil.rmtree(part, ignore_errors=True)


def rename_durably(old: Path, new: Path) -> None:
    """Rename a file or folder, replacing an older file ``new``, so that the change survives a crash of the machine."""
    old.replace(new)
    sync_folder(new.parent)


def sync_folder(folder: Path) -> None:
    """Write the names in a folder to disk, if its file system supports this."""
    with suppress(OSError):
        opened = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(opened)
        finally:
            os.close(opened)


def free_disk_bytes(folder: Path) -> int:
    """Return the number of free bytes on the disk that holds ``folder``, which need not exist yet."""
    return shutil.disk_usage(_nearest_existing(folder)).free


def _nearest_existing(folder: Path) -> Path:
    return next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())


def check_writable(folder: Path) -> None:
    """Raise BadInput if ``folder`` could not be created or written to; nothing is created."""
    check_on_disk(folder)
    existing = _nearest_existing(folder)
    if not existing.is_dir():
        raise unwritable(folder, NotADirectoryError(errno.ENOTDIR, "", str(existing)))
    if not os.access(existing, os.W_OK):
        raise unwritable(folder, PermissionError(errno.EACCES, "", str(existing)))


def check_file_system(folder: Path) -> None:
    """Raise BadInput if files in ``folder`` cannot be synced to disk, locked as HDF5 locks them, or replaced by others.

    Some file systems on a network or an object store cannot do this, and half-written files would be mistaken for
    complete ones. The check writes two small files and removes them.
    """
    new, old = temporary_name(folder / "new"), temporary_name(folder / "old")
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
                _lock_like_hdf5(file.fileno())
        step = "replace a file by another"
        new.replace(old)
        if old.read_bytes() != b"new":
            raise OSError(errno.EIO, "")
    except OSError as error:
        if not step:
            raise unwritable(folder, error) from error
        raise BadInput(
            f"the file system of {folder} cannot {step}: {os.strerror(error.errno or errno.EIO)}",
            allowed="a file system with atomic renaming, such as ext4, XFS, NFS, Lustre or BeeGFS",
            hint=f"set {LOCKING}=FALSE if only one process writes each file" if step == "lock files" else "",
        ) from error
    finally:
        for path in (new, old):
            with suppress(OSError):
                path.unlink(missing_ok=True)


def _lock_like_hdf5(file: int) -> None:
    try:
        _lock(file)
    except OSError as error:
        if error.errno != errno.ENOSYS:  # HDF5 works without locks if the system has none at all
            raise


class DiskFull(BadInput):
    """No disk space is left, or none of the user's quota: nothing else can be written either."""


def unwritable(path: Path, error: OSError) -> BadInput:
    """Return the error for a file that cannot be written; it shows final names in place of temporary ones."""
    reason = os.strerror(error.errno) if error.errno else str(error)
    names = (found["name"] if (found := _TEMPORARY.fullmatch(name)) else name for name in path.parts)
    problem = f"{Path(*names)} cannot be written: {reason}"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return DiskFull(problem, hint="free disk space and run the same command again to go on")
    return BadInput(problem, hint="choose another folder")


def undeletable(path: Path, error: OSError) -> BadInput:
    """Return the error for a folder in which files cannot be deleted."""
    reason = os.strerror(error.errno) if error.errno else str(error)
    return BadInput(f"files in {path} cannot be deleted: {reason}", hint="change its permissions")


def remove_leftovers(folder: Path, *, recursive: bool = False) -> None:
    """Remove temporary files and folders of ended processes in ``folder`` and, with ``recursive``, below it.

    Those of another machine, and all on Windows, are removed if they have not changed for ABANDONED_S seconds.
    """
    for part in _find_unfinished(folder, recursive=recursive):
        with suppress(OSError):  # another process has removed it already, or it belongs to another user
            if not _is_leftover(part):
                continue
            if part.is_dir():
                shutil.rmtree(part, ignore_errors=True)
            else:
                part.unlink()


def _find_unfinished(folder: Path, *, recursive: bool) -> Iterator[Path]:
    """Yield temporary files and folders; those in a temporary folder go with it, at any moment."""
    for here, folders, files in os.walk(folder):  # which passes over folders that another process has just removed
        unfinished = {name for name in (*folders, *files) if name.startswith(".") and name.endswith(".part")}
        yield from (Path(here, name) for name in sorted(unfinished))
        folders[:] = [name for name in folders if recursive and name not in unfinished]


@cache
def _remove_leftovers_once(folder: Path) -> None:
    remove_leftovers(folder)


def _is_leftover(part: Path) -> bool:
    found = _TEMPORARY.fullmatch(part.name)
    if found is None:
        return False
    if found["machine"] != _machine() or os.name == "nt":  # where os.kill with signal 0 is Ctrl-C
        return time.time() - part.stat().st_mtime > ABANDONED_S
    return not _is_running(int(found["pid"]))


def temporary_name(final: Path) -> Path:
    """Return a new name next to ``final`` that identifies this process; a file left under it is removed later."""
    # The token distinguishes containers with equal names and process ids, and shards that render the same stack.
    return final.with_name(f".{final.name}.{secrets.token_hex(4)}.{_machine()}.{os.getpid()}.part")


def _machine() -> str:
    """Return a name of this machine and its process namespace that can be part of a file name.

    Machines of one image may share their host name, and the first namespace has the same number on every Linux; the
    number of the boot is theirs alone.
    """
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().replace("-", "")[:12]
        namespace = f"-{boot}-{Path('/proc/self/ns/pid').stat().st_ino:x}"  # a container sees only its own processes
    except OSError:  # not Linux
        namespace = ""
    return re.sub(r"[^A-Za-z0-9-]", "-", socket.gethostname())[:40] + namespace


def _is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True  # it is the process of another user
    return True
