"""Digests of the source of a plug-in class, which change only if its code changes.

The source is the file of the class and the private modules (``_name.py``) in the same folder that it imports, directly
or indirectly. Comments, docstrings, formatting and the location of the folder do not change a digest. Neither did the
move of the plug-ins of saf_gen into ``saf_gen.plugins``, so records from before and after it can be mixed.
"""

import ast
import hashlib
import sys
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path


def class_source_digests(classes: Iterable[type]) -> list[list[str]]:
    """Return the source files of these classes, each as [file name, SHA-256 of its code], sorted.

    A class without a file, such as one defined at an interactive prompt, gives [name of its module, ""].
    """
    digests: dict[Path, list[str]] = {}
    without_file = []
    for cls in classes:
        found = _digest_files(cls)
        digests |= {path: [path.name, digest] for path, digest in found.items()}
        without_file += [] if found else [[cls.__module__, ""]]
    return sorted([*digests.values(), *without_file])


def class_source_files(cls: type) -> list[Path]:
    """Return the file of a class, then the private modules in its folder that it imports; [] if it has no file."""
    return list(_digest_files(cls))


def _digest_files(cls: type) -> dict[Path, str]:
    file = getattr(sys.modules.get(cls.__module__), "__file__", None)
    if file is None:
        return {}
    to_read = [Path(file).resolve()]
    package = cls.__module__ if to_read[0].stem == "__init__" else cls.__module__.rpartition(".")[0]
    digests: dict[Path, str] = {}
    while to_read:
        path = to_read.pop()
        if path not in digests and path.is_file():
            digests[path], helpers = _digest(path.read_bytes(), package)
            to_read += [path.with_name(f"{helper}.py") for helper in helpers]
    return digests


def source_digest(path: Path) -> str:
    """Return the SHA-256 of the code in a file; raises OSError if it cannot be read."""
    return _digest(path.read_bytes(), "")[0]


@lru_cache(maxsize=256)
def _digest(source: bytes, package: str) -> tuple[str, tuple[str, ...]]:
    """Return the digest of a source and the private modules of ``package`` that it imports anywhere."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):  # a helper that is imported late may need another version of Python
        return hashlib.sha256(source).hexdigest(), ()
    helpers = tuple(sorted(_private_imports(tree, f"{package}." if package else "")))
    return hashlib.sha256(ast.unparse(_DigestedCode().visit(tree)).encode()).hexdigest(), helpers


class _DigestedCode(ast.NodeTransformer):
    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        is_text = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return None if is_text else node

    def visit_ImportFrom(self, node: ast.ImportFrom) -> ast.ImportFrom:
        if node.module and node.module.startswith("saf_gen.plugins."):
            node.module = node.module.replace(".plugins", "", 1)  # the package when records were first published
        return node


def _private_imports(tree: ast.AST, prefix: str) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level <= 1:
            base = (prefix if node.level else "") + (f"{node.module}." if node.module else "")
            names = [f"{base}{alias.name}" for alias in node.names]
        else:
            continue
        inside = [name.removeprefix(prefix) for name in names if name.startswith(prefix)]
        yield from {name.partition(".")[0] for name in inside if name.startswith("_")}
