"""What a focus measure or a search says of itself: in a cell of the list, or on a page of its own."""

import re
from collections.abc import Iterator
from dataclasses import MISSING, fields
from inspect import cleandoc
from typing import Any

from rich.table import Table
from rich.text import Text

from saf_gen.benchmark.method_spec import split_plugin_options
from saf_gen.core.config.registry import build, plugin_class
from saf_gen.errors import BadInput
from saf_gen.measures import BrightnessNormalised, IntervalTexture
from saf_gen.parts import cite_source, commands, wants_halves, wants_intervals, wants_measures

__all__ = [
    "build_or_class",
    "build_plugin_page",
    "first_paragraph",
    "format_attribute",
    "measure_suffixes",
    "search_kind",
]

UNKNOWN = "-"


def build_or_class(plugin_kind: str, name: str) -> Any:
    """The part ``name`` without options; its class where it needs some. Raises as plugin_class does."""
    try:
        return build(plugin_kind, name)
    except BadInput:
        return plugin_class(plugin_kind, name)


def format_attribute(part: Any, key: str) -> str:
    """What a part, or a class of parts, states under ``key``: '-' for nothing."""
    try:
        value = getattr(part, key, None)
    except Exception as error:  # noqa: BLE001 a property of anybody's part may raise anything
        return f"? {type(error).__name__}: {error}"
    if isinstance(part, type) and isinstance(value, property):
        return "by its options"
    if isinstance(value, float):
        return f"{value:.3g}"
    return UNKNOWN if value is None else str(value)


def first_paragraph(part: Any) -> str:
    """The first paragraph of a part's docstring, in one line."""
    return " ".join((part.__doc__ or "").split("\n\n")[0].split())


def search_kind(part: Any) -> str:
    """What kind of search a part says it is."""
    if commands(part):
        return "commands"
    return f"estimates{', causal' if getattr(part, 'causal', None) is True else ''}"


def measure_suffixes(part: Any) -> Iterator[str]:
    """What may stand behind the name of a measure: ``_n`` where it grows with brightness, ``_tfi``."""
    whole = not (wants_halves(part) or wants_intervals(part))
    grows = isinstance(degree := getattr(part, "degree", 0), int) and degree > 0
    if grows:
        yield "_n"
    if whole:
        yield "_tfi"
    if grows and whole:
        yield "_n_tfi"


def build_plugin_page(title: str, plugin_kind: str, part: Any) -> Table:
    """All that a part says of itself, a line a thing. ``title``: its name as it was asked for."""
    table = Table(
        title=Text(title, "bold"), title_justify="left", show_header=False, box=None, pad_edge=False
    )
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    for key, text in _lines(split_plugin_options(title)[0], plugin_kind, part):
        table.add_row(key, Text(text))
    return table


def _lines(name: str, plugin_kind: str, part: Any) -> Iterator[tuple[str, str]]:
    layers = [part]
    while isinstance(layers[-1], BrightnessNormalised | IntervalTexture):
        layers.append(layers[-1].measure)
    inner = layers[-1]
    yield "kind", "focus measure" if plugin_kind == "measures" else f"search, {search_kind(part)}"
    yield "what", "\n\n".join(_prose(type(layer)) for layer in reversed(layers))
    yield "options", "\n".join(_options(inner)) or "none"
    if plugin_kind == "measures":
        yield "looks at", _input(part)
        yield "range", format_attribute(part, "score_range")
        yield "degree", format_attribute(part, "degree")
        cost = format_attribute(part, "cost")
        yield (
            "cost",
            cost if cost == UNKNOWN else f"{cost} operations a pixel (additions, multiplications, roots)",
        )
        if part is inner:
            yield "twins", ", ".join(f"{name}{twin}" for twin in measure_suffixes(part)) or "none"
    elif wants_measures(part):
        yield "looks through", ", ".join(wants_measures(part))
    stated = format_attribute(part, "source")
    yield "source", cite_source(part) or UNKNOWN if stated == UNKNOWN else stated
    if ":" not in name:  # else the name says it
        yield "class", f"{type(inner).__module__}:{type(inner).__qualname__}"


def _prose(cls: type) -> str:
    """Return a docstring up to its first section, with each paragraph that is not set in on one line."""
    text = re.split(r"\n\n\w+\n-+\n", cleandoc(cls.__doc__ or UNKNOWN))[0]
    return "\n\n".join(p if p.startswith(" ") else " ".join(p.split()) for p in text.split("\n\n"))


def _options(part: Any) -> Iterator[str]:
    for field in fields(part):
        if not field.init:
            continue
        value = getattr(part, field.name)
        plain = field.default if field.default_factory is MISSING else field.default_factory()
        told = "" if value == plain else f" (default: {'none' if plain is MISSING else _spelled(plain)})"
        yield f"{field.name.rstrip('_')}={_spelled(value)}{told}"


def _spelled(value: object) -> str:
    """As in the name of a method."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _input(measure: Any) -> str:
    if wants_halves(measure):
        return "spike counts of the two halves of a window"
    return "the texture from intervals" if wants_intervals(measure) else "spike counts of a window"
