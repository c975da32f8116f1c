"""The source behind a part: its own file, and what that imports from the same home.

The home of a module in a package is its top-level package, that of a lone file its folder. Of saf_gen only
the rooms of parts are followed: the rest of it is no property of a method. Imports are read, not run.
"""

import ast
import hashlib
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from saf_gen.core.config.registry import PLUGIN_KINDS

__all__ = ["imported_modules", "read_source", "source_digests"]

HERE = Path(__file__).resolve().parents[2]
OWN = tuple(f"{HERE.name}.{room}" for room in PLUGIN_KINDS)


def source_digests(classes: Iterable[type]) -> list[list[str]]:
    """The files behind these classes, each as [name within its home, sha256 of its text], sorted.

    Where a home lies is not in it, nor how lines end: the same files in another folder give the same. A class
    of no file, as of an interpreter's prompt, is there with the name of its module and no digest.
    """
    found: dict[Path, list[str]] = {}
    bare: list[list[str]] = []
    todo: list[_File] = []
    for cls in classes:
        path = _path_of(cls.__module__)
        if path is None:
            bare.append([cls.__module__, ""])
        else:
            todo.append(_file_of(cls.__module__, path))
    while todo:
        file = todo.pop()
        if file.path in found:
            continue
        text = read_source(file.path)
        found[file.path] = [file.key, hashlib.sha256(text).hexdigest()]
        todo += file.followed(imported_modules(text, file.package))
    return sorted([*found.values(), *bare])


def read_source(path: Path) -> bytes:
    """A file as digests take it: however its lines end; nothing where no source is kept."""
    try:
        return path.read_bytes().replace(b"\r\n", b"\n")
    except OSError:
        return b""


@dataclass(frozen=True)
class _File:
    """A module's file. ``root``: the folder that its name begins in; ``top``: its package, '' of a folder."""

    name: str
    path: Path
    root: Path
    top: str

    @property
    def key(self) -> str:
        end = "/__init__.py" if self.path.stem == "__init__" else self.path.suffix
        return self.name.replace(".", "/") + end

    @property
    def package(self) -> str:
        return self.name if self.path.stem == "__init__" else self.name.rpartition(".")[0]

    def followed(self, names: Iterable[str]) -> Iterator["_File"]:
        """The files of these modules, as far as they are of the same home or of saf_gen's rooms."""
        for name in names:
            top = name.partition(".")[0]
            if top == HERE.name:
                home = (HERE.parent, HERE.name) if name.startswith(OWN) else None
            elif self.top:
                home = (self.root, self.top) if top == self.top else None
            else:
                home = None if _installed(self.root) else (self.root, "")
            path = home and _found(name, *home)
            if home and path:
                yield _File(name, path, *home)


def _file_of(module: str, path: Path) -> _File:
    parts = module.split(".")
    within = [*parts, "__init__"] if path.stem == "__init__" else parts
    if len(within) > 1 and list(path.with_suffix("").parts[-len(within) :]) == within:
        return _File(module, path, path.parents[len(within) - 1], parts[0])
    return _File(path.stem, path, path.parent, "")  # a lone file, by whatever name it was loaded


def _found(name: str, root: Path, top: str) -> Path | None:
    """Where a module of a home lies: where it was loaded from, else where it would be found."""
    place = root.joinpath(*name.split("."))
    there = next(
        (p for p in (place / "__init__.py", place.with_name(place.name + ".py")) if p.is_file()), None
    )
    loaded = _path_of(name)
    if top:
        return loaded or there
    # Beside a lone file only what lies there is its own: another module of that name may have come first.
    return None if there is None or (loaded and _installed(loaded.parent)) else loaded or there


def _path_of(module: str) -> Path | None:
    file = getattr(sys.modules.get(module), "__file__", None)
    return Path(file).resolve() if file else None


def _installed(folder: Path) -> bool:
    """Whether a folder is Python's own, or one of installed packages, where neighbours are strangers."""
    library = Path(sysconfig.get_path("stdlib")).resolve()
    return bool({"site-packages", "dist-packages"} & set(folder.parts)) or folder.is_relative_to(library)


@lru_cache(maxsize=256)
def imported_modules(text: bytes, package: str) -> tuple[str, ...]:
    """Modules that a source may import, within functions too; names that are no modules are among them."""
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError):  # not Python, or not of this version
        return ()
    names: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:  # all of a.b.c are run, and a is what gets a name
                parts = alias.name.split(".")
                names += [".".join(parts[: n + 1]) for n in range(len(parts))]
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")
            if node.level > len(above) or (node.level and not package):
                continue
            base = above[: len(above) - node.level + 1] if node.level else []
            base += node.module.split(".") if node.module else []
            names += [".".join([*base, *end]) for end in ([], *([alias.name] for alias in node.names))]
    return tuple(names)
