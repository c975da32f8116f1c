"""How a fault is planted: in a separate process, the source of a module is changed when it is imported.

A finder in front of Python's own gives the changed modules a loader that compiles other text. So every module with
``from x import y`` gets the faulty y, kernels are compiled with the fault, and no file is changed.
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
        """Return the changed source; raises NotPlantedError if the code stays the same."""
        changed = source.replace(self.old, self.new)
        if self.old not in source:
            raise NotPlantedError(f"saf_gen.{self.module} no longer contains {self.old!r}: update the fault")
        if _code(changed) == _code(source):
            raise NotPlantedError(f"{self.new!r} instead of {self.old!r} changes no code of saf_gen.{self.module}")
        return changed


def changed_sources(changes: Sequence[Change]) -> dict[str, str]:
    """Return the changed source of each module by its full name, without importing it."""
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
    """Return the code without comments, spaces and docstrings."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            node.body[:1] = [ast.Pass()]
    return ast.dump(tree)


class Planter(MetaPathFinder):
    """Gives modules that are imported later a changed source; ``planted`` names those that have been imported."""

    def __init__(self, sources: dict[str, str]) -> None:
        self.sources, self.planted = sources, set[str]()

    def install(self) -> None:
        """Go before the other finders; raises NotPlantedError if one of the modules is already imported."""
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
    """Compiles the changed source without reading or writing Python's cache of the file."""

    def __init__(self, name: str, path: str, planter: Planter) -> None:
        super().__init__(name, path)
        self._planter = planter

    def get_code(self, fullname: str) -> CodeType:
        self._planter.planted.add(fullname)
        return compile(self._planter.sources[fullname], self.path, "exec", dont_inherit=True)


class Outcomes:
    """A pytest plugin that keeps the outcome of each test: passed, failed by an assertion, skipped, or its error."""

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
