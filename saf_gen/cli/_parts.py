"""What a focus measure or a search says of itself: in a cell of the list, or on a page of its own."""

from collections.abc import Iterator
from dataclasses import MISSING, fields
from inspect import cleandoc
from typing import Any

from rich.table import Table
from rich.text import Text

from saf_gen.errors import BadInput
from saf_gen.measures import ByBrightness, FromIntervals
from saf_gen.methods import half_of
from saf_gen.parts import commands, wants_halves, wants_intervals, wants_measures
from saf_gen.registry import build, part_class

__all__ = ["kind_of", "made", "page_of", "stated", "summary", "twins_of"]

UNKNOWN = "-"


def made(room: str, name: str) -> Any:
    """The part ``name`` without options; its class where it needs some. Raises as part_class does."""
    try:
        return build(room, name)
    except BadInput:
        return part_class(room, name)


def stated(part: Any, key: str) -> str:
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


def summary(part: Any) -> str:
    """The first paragraph of a part's docstring, in one line."""
    return " ".join((part.__doc__ or "").split("\n\n")[0].split())


def kind_of(part: Any) -> str:
    """What kind of search a part says it is."""
    if commands(part):
        return "commands"
    return f"estimates{', causal' if getattr(part, 'causal', None) is True else ''}"


def twins_of(part: Any) -> Iterator[str]:
    """What may stand behind the name of a measure: ``_n`` where it grows with brightness, ``_tfi``."""
    whole = not (wants_halves(part) or wants_intervals(part))
    grows = isinstance(degree := getattr(part, "degree", 0), int) and degree > 0
    if grows:
        yield "_n"
    if whole:
        yield "_tfi"
    if grows and whole:
        yield "_n_tfi"


def page_of(title: str, room: str, part: Any) -> Table:
    """All that a part says of itself, a line a thing. ``title``: its name as it was asked for."""
    table = Table(
        title=Text(title, "bold"), title_justify="left", show_header=False, box=None, pad_edge=False
    )
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    for key, text in _lines(half_of(title)[0], room, part):
        table.add_row(key, Text(text))
    return table


def _lines(name: str, room: str, part: Any) -> Iterator[tuple[str, str]]:
    layers = [part]
    while isinstance(layers[-1], ByBrightness | FromIntervals):
        layers.append(layers[-1].measure)
    inner = layers[-1]
    yield "kind", "focus measure" if room == "measures" else f"search, {kind_of(part)}"
    yield "what", "\n\n".join(_prose(type(layer)) for layer in reversed(layers))
    yield "options", "\n".join(_options(inner)) or "none"
    if room == "measures":
        yield "looks at", _input(part)
        yield "range", stated(part, "score_range")
        yield "degree", stated(part, "degree")
        cost = stated(part, "cost")
        yield (
            "cost",
            cost if cost == UNKNOWN else f"{cost} operations a pixel (additions, multiplications, roots)",
        )
        if part is inner:
            yield "twins", ", ".join(f"{name}{twin}" for twin in twins_of(part)) or "none"
    elif wants_measures(part):
        yield "looks through", ", ".join(wants_measures(part))
    yield "source", stated(part, "source")
    if ":" not in name:  # else the name says it
        yield "class", f"{type(inner).__module__}:{type(inner).__qualname__}"


def _prose(cls: type) -> str:
    """A docstring without the line breaks of its file; what is set in stays as it is."""
    paragraphs = cleandoc(cls.__doc__ or UNKNOWN).split("\n\n")
    return "\n\n".join(p if p.startswith(" ") else " ".join(p.split()) for p in paragraphs)


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
