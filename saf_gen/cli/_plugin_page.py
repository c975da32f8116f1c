"""What a focus measure or a search states about itself, for ``methods`` and ``methods show``."""

import re
from collections.abc import Iterator
from dataclasses import MISSING, fields
from inspect import cleandoc
from typing import Any

from rich.table import Table
from rich.text import Text

from saf_gen.benchmark.method_spec import split_method_options
from saf_gen.core.config.registry import build_plugin, plugin_class
from saf_gen.errors import BadInput
from saf_gen.measures import BrightnessNormalised, IntervalTexture
from saf_gen.parts import cite_source, commands, wants_halves, wants_intervals, wants_measures

UNKNOWN = "-"


def build_or_class(plugin_kind: str, name: str) -> Any:
    """Return the plug-in ``name`` built without options, or its class where it needs some.

    Raises BadInput where it cannot be loaded.
    """
    try:
        return build_plugin(plugin_kind, name)
    except BadInput:
        return plugin_class(plugin_kind, name)


def format_attribute(plug_in: Any, key: str) -> str:
    """Return what a plug-in, or its class, states as attribute ``key``; '-' if it states nothing."""
    try:
        value = getattr(plug_in, key, None)
    except Exception as error:  # noqa: BLE001  (a property of anybody's plug-in may raise anything)
        return f"? {type(error).__name__}: {error}"
    if isinstance(plug_in, type) and isinstance(value, property):
        return "depends on options"
    if isinstance(value, float):
        return f"{value:.3g}"
    return UNKNOWN if value is None else str(value)


def first_paragraph(plug_in: Any) -> str:
    """Return the first paragraph of a plug-in's docstring on one line."""
    return " ".join((plug_in.__doc__ or "").split("\n\n")[0].split())


def search_kind(plug_in: Any) -> str:
    """Return whether a search commands the lens or estimates, and whether it is causal."""
    if commands(plug_in):
        return "commands"
    return f"estimates{', causal' if getattr(plug_in, 'causal', None) is True else ''}"


def measure_suffixes(measure: Any) -> Iterator[str]:
    """Yield the suffixes of the forms that a measure has: ``_n``, ``_tfi`` and ``_n_tfi``."""
    whole = not (wants_halves(measure) or wants_intervals(measure))
    grows = isinstance(degree := getattr(measure, "degree", 0), int) and degree > 0
    if grows:
        yield "_n"
    if whole:
        yield "_tfi"
    if grows and whole:
        yield "_n_tfi"


def build_plugin_page(title: str, plugin_kind: str, *, plug_in: Any) -> Table:
    """Return everything that a plug-in states about itself; ``title`` is its name as the user wrote it."""
    table = Table(title=Text(title, "bold"), title_justify="left", show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    for key, text in _lines(split_method_options(title)[0], plugin_kind, plug_in=plug_in):
        table.add_row(key, Text(text))
    return table


def _lines(name: str, plugin_kind: str, *, plug_in: Any) -> Iterator[tuple[str, str]]:
    layers = [plug_in]
    while isinstance(layers[-1], BrightnessNormalised | IntervalTexture):
        layers.append(layers[-1].measure)
    inner = layers[-1]
    yield "kind", "focus measure" if plugin_kind == "measures" else f"search, {search_kind(plug_in)}"
    yield "what", "\n\n".join(_prose(type(layer)) for layer in reversed(layers))
    yield "options", "\n".join(_options(inner)) or "none"
    if plugin_kind == "measures":
        yield "input", _input(plug_in)
        yield "range", format_attribute(plug_in, "score_range")
        yield "degree", format_attribute(plug_in, "degree")
        cost = format_attribute(plug_in, "cost")
        yield ("cost", cost if cost == UNKNOWN else f"{cost} operations per pixel (additions, multiplications, roots)")
        if plug_in is inner:
            yield "forms", ", ".join(f"{name}{form}" for form in measure_suffixes(plug_in)) or "none"
    elif wants_measures(plug_in):
        yield "also scores", ", ".join(wants_measures(plug_in))
    stated = format_attribute(plug_in, "source")
    yield "source", cite_source(plug_in) or UNKNOWN if stated == UNKNOWN else stated
    if ":" not in name:  # otherwise the name contains it
        yield "class", f"{type(inner).__module__}:{type(inner).__qualname__}"


def _prose(cls: type) -> str:
    """Return a docstring up to its first section, with each paragraph that is not indented on one line."""
    text = re.split(r"\n\n\w+\n-+\n", cleandoc(cls.__doc__ or UNKNOWN))[0]
    return "\n\n".join(p if p.startswith(" ") else " ".join(p.split()) for p in text.split("\n\n"))


def _options(plug_in: Any) -> Iterator[str]:
    for field in fields(plug_in):
        if not field.init:
            continue
        value = getattr(plug_in, field.name)
        plain = field.default if field.default_factory is MISSING else field.default_factory()
        default = "" if value == plain else f" (default: {'none' if plain is MISSING else _format_option(plain)})"
        yield f"{field.name.rstrip('_')}={_format_option(value)}{default}"


def _format_option(value: object) -> str:
    """Return a value as the name of a method spells it."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _input(measure: Any) -> str:
    """Return what a measure is given."""
    if wants_halves(measure):
        return "spike counts of the two halves of a window"
    return "the interval texture of a window" if wants_intervals(measure) else "spike counts of a window"
