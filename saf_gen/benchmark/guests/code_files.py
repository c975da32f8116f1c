"""The files of which the code of a guest consists, as its process finds them: names and digests."""

import os
import sys
import sysconfig
from contextlib import suppress
from importlib.util import source_from_cache
from pathlib import Path
from typing import Any

from saf_gen.core.config.source_digest import source_digest
from saf_gen.core.files import file_sha256
from saf_gen.errors import BadInput

PACKAGE = Path(__file__).resolve().parents[2]
PACKAGES = {"site-packages", "dist-packages"}
"""Names of folders that hold installed packages, wherever they are."""
_SYSTEM = [
    Path(root).resolve()
    for root in {sys.prefix, sys.base_prefix, *sysconfig.get_paths().values(), "/proc", "/sys", "/dev", "/etc", "/usr"}
]
"""Folders whose files belong to Python, to packages or to the machine, not to a method."""
_COMPILED = (".nbi", ".nbc")
"""Endings of the files in which numba keeps what it compiled."""
_OPENING = ("open", "import", "ctypes.dlopen", "sqlite3.connect")
"""Audit events (PEP 578) of which the first detail, or the second one of an import, is the path of a file."""


class CodeFiles:
    """The files of a method: those that the user named, its modules, and what it opens until :meth:`finish`.

    Parameters
    ----------
    named : list of str
        Absolute paths of the files that its names and options name.
    folders : list of str
        Folders whose modules it may import.
    """

    def __init__(self, named: list[str], folders: list[str]) -> None:
        self._named, self._folders, self._packages = set(map(Path, named)), list(map(Path, folders)), list[Path]()
        self._paths, self._opened, self._is_loading = set(self._named), set[str](), True
        self._modules = set(sys.modules)
        sys.addaudithook(self._note)

    def _note(self, event: str, details: tuple[Any, ...]) -> None:
        if not self._is_loading or event not in _OPENING or not details:
            return
        name = details[1] if event == "import" else details[0]
        if isinstance(name, str | bytes) and (event != "open" or _is_reading(details[2])):
            with suppress(OSError, ValueError):
                self._opened.add(os.path.abspath(os.fsdecode(name)))  # noqa: PTH100  pathlib is slower

    def finish(self, of_classes: list[Path], packages: list[str]) -> None:
        """Take the files of the classes of the method, all that was opened, and the modules that were imported."""
        self._is_loading = False
        modules = [module for name, module in list(sys.modules.items()) if name not in self._modules]
        sources = [file for module in modules if (file := getattr(module, "__file__", None))]
        self._named |= set(of_classes)
        self._packages = list(map(Path, packages))
        self._paths |= self._named
        for text in (*self._opened, *sources):
            with suppress(OSError, ValueError, RuntimeError):  # a loop of links, or no path at all
                path = Path(_source_of(text)).resolve()
                self._paths |= set() if text.endswith(_COMPILED) or Path.cwd() in path.parents else {path}

    def digests(self) -> list[list[str]]:
        """Return name and digest of each file as it is now, sorted, without those that cannot be read."""
        named = {path: name for path in self._paths if (name := self._name(path))}
        found = {(name, digest) for path, name in named.items() if (digest := _digest(path))}
        return sorted(map(list, found))

    def _name(self, path: Path) -> str:
        """Return the name of a file in the digest: relative to the method's folder; '' for a file of no method."""
        if path.is_relative_to(PACKAGE):
            return path.name if path.parent.parent == PACKAGE / "plugins" else ""
        packages = [package.parent for package in self._packages if package in path.parents]
        for folder in (*self._folders, *packages):
            if path.is_relative_to(folder):
                return path.relative_to(folder).as_posix()
        is_of_the_machine = path not in self._named and (
            not PACKAGES.isdisjoint(path.parts)
            or path.parent.suffix == ".dist-info"
            or any(path.is_relative_to(root) for root in _SYSTEM)
        )
        return "" if is_of_the_machine else path.name


def _digest(path: Path) -> str:
    """Return the digest of a file, of which remarks in Python are no part; '' if it cannot be read or is no file."""
    try:
        if not path.is_file():
            return ""
        return source_digest(path) if path.suffix == ".py" else file_sha256(path)
    except (OSError, ValueError, BadInput):
        return ""


def _is_reading(flags: Any) -> bool:
    """Return whether a file is opened with its content, which a file that is made or emptied does not have."""
    return not isinstance(flags, int) or not flags & (os.O_WRONLY | os.O_TRUNC | os.O_EXCL)


def _source_of(path: str) -> str:
    """Return the source of a compiled module, whose time stamp would change the digest."""
    if path.endswith(".pyc") and "__pycache__" in path:
        with suppress(ValueError, NotImplementedError):
            return source_from_cache(path)
    return path
