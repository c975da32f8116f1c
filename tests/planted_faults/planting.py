"""How a fault is planted: the source of a module is changed as it is imported, in a process of its own.

A finder stands before Python's own, and gives the changed modules a loader that compiles other text. So every module
that says ``from x import y`` gets the faulty y, compiled kernels are compiled with the fault, and no file is touched.
"""

import ast
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.util import find_spec
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import pytest


class NotPlantedError(Exception):
    """A fault that would change nothing."""


@dataclass(frozen=True)
class Change:
    """Every ``old`` in the source of ``module`` (its name without saf_gen) becomes ``new``."""

    module: str
    old: str
    new: str

    def apply(self, source: str) -> str:
        """Return the changed source; NotPlantedError where the code stays the same."""
        changed = source.replace(self.old, self.new)
        if self.old not in source:
            raise NotPlantedError(f"saf_gen.{self.module} no longer says {self.old!r}: plant it in what stands there")
        if _code(changed) == _code(source):
            raise NotPlantedError(f"{self.new!r} for {self.old!r} changes no code of saf_gen.{self.module}")
        return changed


def changed_sources(changes: Sequence[Change]) -> dict[str, str]:
    """The source of each module that the changes are in, changed, by its whole name; nothing is imported."""
    package = find_spec("saf_gen")
    assert package is not None and package.submodule_search_locations  # noqa: PT018
    folder, sources = Path(package.submodule_search_locations[0]), dict[str, str]()
    for change in changes:
        path = folder / change.module.replace(".", "/")
        path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        name = f"saf_gen.{change.module}"
        sources[name] = change.apply(sources.get(name) or path.read_text(encoding="utf-8"))
    return sources


def _code(source: str) -> str:
    """The code without comments, spaces and docstrings."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            node.body[:1] = [ast.Pass()]
    return ast.dump(tree)


class Planter(MetaPathFinder):
    """Gives modules that have not been imported yet another source; ``planted`` names those that have been since."""

    def __init__(self, sources: dict[str, str]) -> None:
        self.sources, self.planted = sources, set[str]()

    def install(self) -> None:
        """Stand before the other finders; NotPlantedError where one of the modules is there already."""
        late = sorted(set(self.sources) & set(sys.modules))
        if late:
            raise NotPlantedError(f"{', '.join(late)} was imported before the fault was planted")
        sys.meta_path.insert(0, self)

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        spec = PathFinder.find_spec(name, path, target) if name in self.sources else None
        if spec is not None and spec.origin is not None:
            spec.loader = _ChangedLoader(name, spec.origin, self)
        return spec


class _ChangedLoader(SourceFileLoader):
    """Compiles the changed source, and neither reads nor writes Python's cache of the file."""

    def __init__(self, name: str, path: str, planter: Planter) -> None:
        super().__init__(name, path)
        self._planter = planter

    def get_code(self, fullname: str) -> CodeType:
        self._planter.planted.add(fullname)
        return compile(self._planter.sources[fullname], self.path, "exec", dont_inherit=True)


class Outcomes:
    """A plugin of pytest that keeps how each test ended: passed, failed by an assertion, skipped, or its error."""

    def __init__(self) -> None:
        self.by_test: dict[str, str] = {}

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item, call: pytest.CallInfo[None]) -> Any:
        report = yield
        ended = report.outcome
        if report.failed and call.excinfo is not None:
            asserted = call.when == "call" and call.excinfo.errisinstance((AssertionError, pytest.fail.Exception))
            ended = "failed" if asserted else f"{call.excinfo.typename} in {call.when}: {call.excinfo.value}"
        if self.by_test.get(item.nodeid, "passed") == "passed":
            self.by_test[item.nodeid] = ended
        return report

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            self.by_test[report.nodeid] = f"cannot be collected: {report.longreprtext.strip().splitlines()[-1]}"
