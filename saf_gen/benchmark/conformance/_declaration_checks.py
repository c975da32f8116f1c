"""Checks of what a plug-in states about itself."""

import inspect
from dataclasses import is_dataclass

from saf_gen.benchmark.conformance._check_result import CheckFailure, CheckWarning
from saf_gen.parts import cite_source


def check_conformance_of_class(plug_in: object) -> None:
    """Raise CheckFailure unless the plug-in is a frozen dataclass with a docstring; plain code may lack one."""
    cls = type(plug_in)
    if not is_dataclass(cls):
        raise CheckFailure("is no dataclass", "put @dataclass(frozen=True) above its class")
    if not _is_plain(plug_in) and not cls.__dataclass_params__.frozen:  # type: ignore[attr-defined]
        raise CheckFailure("its dataclass is not frozen", "write @dataclass(frozen=True)")
    docstring = inspect.getdoc(cls) or ""
    if not docstring or docstring.startswith(f"{cls.__name__}("):  # dataclass fills in its fields
        raise _missing(plug_in)("it has no docstring", "write what the plug-in does, its options and its range")


def _is_plain(plug_in: object) -> bool:
    """Return whether a plug-in was made of a function or of a class that is no dataclass."""
    return hasattr(type(plug_in), "plain")


def _missing(plug_in: object) -> type[CheckFailure]:
    """Return how a missing text is reported: who wrote a function for a day need not cite anybody."""
    return CheckWarning if _is_plain(plug_in) else CheckFailure


def check_conformance_of_docs(plug_in: object) -> str:
    """The plug-in is plain code, or a frozen dataclass, with a docstring and a source."""
    check_conformance_of_class(plug_in)
    source = cite_source(plug_in)
    if not source:
        raise _missing(plug_in)(
            "it cites no source",
            'add source: ClassVar[str] = "the paper, with its DOI", or a section References to its docstring',
        )
    made_of = "plain code" if _is_plain(plug_in) else "a frozen dataclass"
    return f"{made_of} with a docstring; source: {source}"
