"""Checks of what a plug-in states about itself."""

import inspect
from dataclasses import is_dataclass

from saf_gen.benchmark.conformance._check_result import CheckFailure
from saf_gen.parts import cite_source


def check_plugin_class(plug_in: object) -> None:
    """Raise CheckFailure unless the plug-in is a frozen dataclass with a docstring."""
    cls = type(plug_in)
    if not is_dataclass(cls):
        raise CheckFailure("is no dataclass", "put @dataclass(frozen=True) above its class")
    if not cls.__dataclass_params__.frozen:  # type: ignore[attr-defined]
        raise CheckFailure("its dataclass is not frozen", "write @dataclass(frozen=True)")
    docstring = inspect.getdoc(cls) or ""
    if not docstring or docstring.startswith(f"{cls.__name__}("):  # dataclass fills in its fields
        raise CheckFailure("its class has no docstring", "write what the plug-in does, its options and its range")


def check_plugin_description(plug_in: object) -> str:
    """The plug-in is a frozen dataclass with a docstring and a source."""
    check_plugin_class(plug_in)
    source = cite_source(plug_in)
    if not source:
        raise CheckFailure(
            "it cites no source",
            'add source: ClassVar[str] = "the paper, with its DOI", or a section References to its docstring',
        )
    return f"a frozen dataclass with a docstring; source: {source}"
