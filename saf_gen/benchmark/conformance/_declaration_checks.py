"""What a part must say of itself."""

import inspect
from dataclasses import is_dataclass

from saf_gen.benchmark.conformance._check_result import CheckFailure
from saf_gen.parts import cite_source

__all__ = ["check_class", "described"]


def check_class(part: object) -> None:
    """Raises CheckFailure unless the part is a frozen dataclass with a docstring."""
    cls = type(part)
    if not is_dataclass(cls):
        raise CheckFailure("is no dataclass", "put @dataclass(frozen=True) above its class")
    if not cls.__dataclass_params__.frozen:  # type: ignore[attr-defined]
        raise CheckFailure("its dataclass is not frozen", "write @dataclass(frozen=True)")
    written = inspect.getdoc(cls) or ""
    if not written or written.startswith(f"{cls.__name__}("):  # dataclass fills in its fields
        raise CheckFailure(
            "its class has no docstring", "say in it what the part does, its options and its range"
        )


def described(part: object) -> str:
    """A frozen dataclass with a docstring and a source."""
    check_class(part)
    source = cite_source(part)
    if not source:
        raise CheckFailure(
            "it cites no source", 'add source: ClassVar[str] = "the paper, with its DOI", or "ours"'
        )
    return f"a frozen dataclass with a docstring; source: {source}"
