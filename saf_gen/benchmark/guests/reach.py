"""What a guest may use of the file system: Python, this package and its own folders, but no dataset and no evaluation.

Landlock only allows, so what leads to a dataset is left out by allowing all that is beside it.
"""

import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from saf_gen.benchmark.guests.code_files import PACKAGE
from saf_gen.core.child import Reach

SYSTEM = (
    *("/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/libx32", "/opt", "/nix/store", "/proc", "/sys"),
    *("/dev/zero", "/dev/random", "/dev/urandom", "/etc/ld.so.cache", "/etc/ld.so.preload", "/etc/localtime"),
    *("/etc/nsswitch.conf", "/etc/passwd", "/etc/group", "/etc/os-release", "/etc/mime.types", "/etc/fonts"),
    *("/etc/OpenCL", "/etc/vulkan"),
)
DEVICES = ("/dev/null", "/dev/dri", "/dev/kfd")
"""Beside those of NVIDIA."""
DATASET_FILES = {"manifest.json", "records.jsonl", "leaderboard.json"}
RECORDING = (".h5", ".hdf5", ".exr")
MAX_ENTRIES, MAX_DEPTH = 20_000, 32
"""Numbers of files and folders, and of folders in one another, that are looked at in each folder of a method; what is
beyond cannot be read."""


def reach_of(folders: Iterable[str], files: Iterable[str], *, own: Path) -> Reach | None:
    """Return what a guest may use: the folders and files of its method, and a folder of its own for any use.

    Returns None, which shuts nothing in, where the system has no Landlock anyway.
    """
    if sys.platform != "linux":
        return None
    own_folders = [str(Path(folder).resolve()) for folder in folders]
    imported = [Path(path).resolve() for path in sys.path if path and Path(path).is_dir()]
    stated = [Path(path).resolve() for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]
    readable, listed = [*SYSTEM, *files], [str(PACKAGE.parent), *own_folders]
    readable += filter(None, os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep))
    for folder in {Path(sys.prefix).resolve(), Path(sys.base_prefix).resolve(), *imported, PACKAGE}:
        if folder == PACKAGE or folder.name.endswith("-packages") or folder not in imported:
            readable += _around_package(folder)
        elif folder == PACKAGE.parent:
            readable += [str(path) for path in folder.glob("*-info")]
        elif folder != Path.cwd() or folder in stated:  # Python begins its path with it, although nobody asked for it
            listed.append(str(folder))
            readable += _besides_datasets(folder)
    for place in own_folders:
        readable += _besides_datasets(Path(place))
    devices = [*DEVICES, *map(str, Path("/dev").glob("nvidia*"))]
    return Reach(list(dict.fromkeys(readable)), listed, [str(own), *devices])


def _around_package(folder: Path) -> Iterator[str]:
    """Yield what is in a folder of Python, except for the datasets that come with this package."""
    if folder == PACKAGE:
        yield from _besides_datasets(folder)
    elif folder not in PACKAGE.parents:
        yield str(folder)
    else:
        for path in folder.iterdir():
            yield from _around_package(path) if path == PACKAGE or path in PACKAGE.parents else (str(path.resolve()),)


def _besides_datasets(folder: Path) -> list[str]:
    """Return what is in a folder, but what is hidden, and what is or holds a recording or a result."""
    left = [MAX_ENTRIES]

    def walk(folder: str, depth: int) -> tuple[list[str], bool]:
        """Return what may be read in a folder, and whether that is all of it."""
        allowed, is_all = list[str](), True
        try:
            entries = list(os.scandir(folder)) if depth < MAX_DEPTH else []
        except OSError:
            return [], False
        if depth == MAX_DEPTH or (depth and any(_is_data(entry.name) for entry in entries)):
            return [], False
        for entry in entries:
            left[0] -= 1
            if left[0] < 0 or entry.name.startswith(".") or entry.is_symlink():
                is_all = False
            elif entry.is_dir(follow_symlinks=False):
                within, is_whole = walk(entry.path, depth + 1)
                allowed += [entry.path] if is_whole else within
                is_all &= is_whole
            elif entry.is_file(follow_symlinks=False) and not _is_data(entry.name):
                allowed.append(entry.path)
            else:
                is_all = False
        return allowed, is_all

    return walk(str(folder), 0)[0]


def _is_data(name: str) -> bool:
    return name in DATASET_FILES or name.endswith(RECORDING)
