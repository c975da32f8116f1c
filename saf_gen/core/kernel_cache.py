"""The folder in which numba keeps compiled kernels, also where neither the installation nor a home can be written."""

import os
import stat
from contextlib import suppress
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"
PREFIX = "saf-gen-kernels-"
NO_OTHER = ", because neither the installation nor a home can be written"
PACKAGE = Path(__file__).resolve().parents[1]


def choose_kernel_cache() -> str:
    """Make sure that numba can keep compiled kernels, and return where, in words.

    Without a folder that it may write to, numba refuses to compile anything that is to be kept. It looks beside the
    source and in the user's cache folder; if both are read-only, as in containers, kernels are kept in a private folder
    under the temporary one. Processes that this one starts use the same folder.
    """
    if stated := os.environ.get(VARIABLE):
        return f"{stated}{NO_OTHER if Path(stated).name.startswith(PREFIX) else f' (${VARIABLE})'}"
    if os.access(PACKAGE, os.W_OK):
        return "beside the source"
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    with suppress(OSError):
        home.mkdir(parents=True, exist_ok=True)  # as numba does
        if os.access(home, os.W_OK):
            return f"the user's cache folder, {home}"
    folder = _private_folder()
    os.environ[VARIABLE] = str(folder)
    return f"{folder}{NO_OTHER}"


def _private_folder() -> Path:
    """Return a folder that only this user can write: what is in it is run."""
    import tempfile  # which takes longer to import than all the rest of this package's beginning

    user = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"{PREFIX}{user}"
    with suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    found = folder.lstat()
    is_private = stat.S_ISDIR(found.st_mode) and not found.st_mode & 0o077 and (os.name == "nt" or found.st_uid == user)
    return folder if is_private else Path(tempfile.mkdtemp(prefix=PREFIX))
