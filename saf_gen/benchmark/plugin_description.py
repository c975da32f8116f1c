"""Descriptions of focus measures and searches: the facts that each states, and its source code.

Methods that records name are built only if saf_gen itself contains them, because a record must not decide whose code is
executed.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from inspect import cleandoc
from typing import Any

from saf_gen.benchmark.method_spec import Method, parse_method, shorten, split_halves, split_options, split_region
from saf_gen.benchmark.records import Record
from saf_gen.core.config.registry import FORM_SUFFIXES, build_plugin, is_builtin_name, names, plugin_class
from saf_gen.core.config.source_digest import class_source_files
from saf_gen.core.user_code import user_code
from saf_gen.errors import BadInput
from saf_gen.parts import cite_source, commands, wants_halves, wants_intervals, wants_measures
from saf_gen.plugins.measures import BrightnessNormalised, IntervalTexture
from saf_gen.plugins.searches import REJECT, Rejecting

UNKNOWN = "-"
MAX_CODE_CHARACTERS = 30_000
"""Maximum number of characters shown of one file; a note replaces the rest."""


@dataclass(frozen=True)
class PluginDescription:
    """A human-readable description of a measure or a search with its options."""

    name: str
    """Name as it occurs in the name of a method, with form and options."""
    plugin_kind: str
    """``measures`` or ``searches``."""
    facts: tuple[tuple[str, str], ...]
    """Key and text of each fact that the plug-in states: purpose, options, range, degree, cost and source."""
    code: tuple[tuple[str, str], ...]
    """Name and text of its file, then of the private files in the same folder that it imports; unreadable files are
    left out."""


def describe_plugin(name: str, plugin_kind: str, *, plug_in: Any) -> PluginDescription:
    """Return the description of a plug-in.

    Parameters
    ----------
    name : str
        Name of the plug-in as the user wrote it.
    plugin_kind : str
        ``measures`` or ``searches``.
    plug_in : Measure or Search
        The plug-in.

    Returns
    -------
    PluginDescription
        Everything that the plug-in states about itself, and its source code.
    """
    layers = [plug_in]
    while isinstance(layers[-1], BrightnessNormalised | IntervalTexture | Rejecting):
        layers.append(layers[-1].search if isinstance(layers[-1], Rejecting) else layers[-1].measure)
    facts = _state_facts(split_options(name)[0], plugin_kind, layers=layers)
    return PluginDescription(name, plugin_kind, tuple(facts), _read_code(type(layers[-1])))


def describe_plugins(methods: Iterable[Method]) -> tuple[PluginDescription, ...]:
    """Return descriptions of the measures of these methods and then of the searches, without repetitions."""
    found: dict[tuple[str, str], PluginDescription] = {}
    for method in methods:
        parts = split_halves(split_region(method.name)[0])
        halves = parts[0], parts[-1]  # a method in a folder has one name
        if method.guest is not None:
            for half, kind in zip(halves, ("measures", "searches"), strict=True):
                found.setdefault((kind, half), take_description(half, kind, said=method.guest.plugins))
            continue
        for half, kind, plug_in in zip(halves, ("measures", "searches"), (method.measure, method.search), strict=True):
            if (kind, half) in found:
                continue
            try:
                with user_code():
                    found[kind, half] = describe_plugin(half, kind, plug_in=plug_in)
            except Exception as error:  # noqa: BLE001  (a third-party plug-in may raise anything)
                problem = f"it cannot be described: {type(error).__name__}: {error}"
                found[kind, half] = PluginDescription(half, kind, (("what", problem),), ())
    return tuple(sorted(found.values(), key=lambda d: d.plugin_kind))


def take_description(half: str, kind: str, *, said: Iterable[Any]) -> PluginDescription:
    """Return what a guest says of one of its plug-ins, of which only texts are taken over."""
    for one in said:
        try:
            if one["plugin_kind"] == kind:
                facts = tuple((str(key)[:100], str(text)[:MAX_CODE_CHARACTERS]) for key, text in one["facts"])
                code = tuple((str(name)[:100], str(text)[: MAX_CODE_CHARACTERS + 100]) for name, text in one["code"])
                return PluginDescription(half, kind, facts, code)
        except (KeyError, TypeError, ValueError):
            break
    return PluginDescription(half, kind, (("what", "it does not describe itself"),), ())


def describe_recorded(records: Iterable[Record]) -> tuple[PluginDescription, ...]:
    """Return descriptions of the plug-ins in records, if saf_gen contains them with the code that made the records."""
    recorded = {record.who.method: record.who.code for record in records}
    methods = []
    for name, code in recorded.items():
        halves = [split_options(half)[0] for half in split_halves(split_region(name)[0])]
        if len(halves) != 2 or not all(map(_is_builtin, ("measures", "searches"), halves)):
            continue
        try:
            method = parse_method(name)
        except BadInput:  # the record is from another version, which had other options
            continue
        if method.code == code:
            methods.append(method)
    return describe_plugins(methods)


def _is_builtin(plugin_kind: str, name: str) -> bool:
    """Return whether a name is that of a plug-in of saf_gen, or of a form of one of its measures, such as ``sd_tfi``.

    A form goes by the name of its measure, but only where nobody has registered a plug-in by its full name.
    """
    if name in names(plugin_kind) or plugin_kind != "measures":
        return is_builtin_name(plugin_kind, name)
    bare = next((name.removesuffix(suffix) for suffix in FORM_SUFFIXES if name.endswith(suffix)), name)
    return bare != name and _is_builtin(plugin_kind, bare)


def build_or_class(plugin_kind: str, name: str) -> Any:
    """Return the plug-in ``name`` built without options, or its class if it needs options.

    Raises BadInput if the plug-in cannot be loaded.
    """
    try:
        return build_plugin(plugin_kind, name)
    except BadInput:
        return plugin_class(plugin_kind, name)


def format_attribute(plug_in: Any, key: str) -> str:
    """Return the text of the attribute ``key`` of a plug-in or its class, or '-' if the attribute is missing."""
    try:
        with user_code():
            value = getattr(plug_in, key, None)
    except Exception as error:  # noqa: BLE001  (a property of a third-party plug-in may raise anything)
        return f"? {type(error).__name__}: {error}"
    if isinstance(plug_in, type) and isinstance(value, property):
        return "depends on options"
    if isinstance(value, float):
        return f"{value:.3g}"
    return UNKNOWN if value is None else str(value)


def summarise_plugin(plug_in: Any) -> str:
    """Return the first paragraph of a plug-in's docstring on one line."""
    return " ".join((plug_in.__doc__ or "").split("\n\n")[0].split())


def search_kind(plug_in: Any) -> str:
    """Return the kind of a search: ``commands``, ``estimates`` or ``estimates, causal``."""
    if commands(plug_in):
        return "commands"
    return f"estimates{', causal' if getattr(plug_in, 'causal', None) is True else ''}"


def measure_suffixes(measure: Any) -> Iterator[str]:
    """Yield the suffixes of the forms that a measure has: ``_n``, ``_tfi`` and ``_n_tfi``."""
    counts_windows = not (wants_halves(measure) or wants_intervals(measure))
    grows = isinstance(degree := getattr(measure, "degree", 0), int) and degree > 0
    if grows:
        yield "_n"
    if counts_windows:
        yield "_tfi"
    if grows and counts_windows:
        yield "_n_tfi"


def _state_facts(name: str, plugin_kind: str, *, layers: Sequence[Any]) -> Iterator[tuple[str, str]]:
    """Yield key and text of each fact of a plug-in; ``layers`` holds it and the measures in it, outermost first."""
    plug_in, inner = layers[0], layers[-1]
    yield "kind", "focus measure" if plugin_kind == "measures" else f"search, {search_kind(plug_in)}"
    yield "what", "\n\n".join(_prose(type(layer)) for layer in reversed(layers))
    options = [*_options(inner)]
    if plugin_kind == "searches" and not any(option.startswith(f"{REJECT}=") for option in options):
        options.append(f"{REJECT}={'true (default: false)' if isinstance(plug_in, Rejecting) else 'false'}")
    yield "options", "\n".join(options) or "none"
    if plugin_kind == "measures":
        yield "input", _input(plug_in)
        yield "range", format_attribute(plug_in, "score_range")
        yield "degree", format_attribute(plug_in, "degree")
        cost = format_attribute(plug_in, "cost")
        yield ("cost", cost if cost == UNKNOWN else f"{cost} operations per pixel (additions, multiplications, roots)")
        if len(layers) == 1:
            yield "forms", ", ".join(f"{name}{form}" for form in measure_suffixes(plug_in)) or "none"
    elif wants_measures(plug_in):
        yield "also scores", ", ".join(wants_measures(plug_in))
    stated = format_attribute(plug_in, "source")
    yield "source", cite_source(plug_in) or UNKNOWN if stated == UNKNOWN else stated
    if ":" not in name:  # otherwise the name contains it
        yield "class", f"{type(inner).__module__}:{type(inner).__qualname__}"


def _prose(cls: type) -> str:
    """Return the docstring of a class up to its first section, with each unindented paragraph on one line."""
    text = re.split(r"\n\n\w+\n-+\n", cleandoc(cls.__doc__ or UNKNOWN))[0]
    return "\n\n".join(p if p.startswith(" ") else " ".join(p.split()) for p in text.split("\n\n"))


def _options(plug_in: Any) -> Iterator[str]:
    for field in fields(plug_in) if is_dataclass(plug_in) else ():
        if not field.init:
            continue
        value = getattr(plug_in, field.name)
        plain = field.default if field.default_factory is MISSING else field.default_factory()
        default = "" if value == plain else f" (default: {'none' if plain is MISSING else _format_option(plain)})"
        yield f"{field.name.rstrip('_')}={_format_option(value)}{default}"


def _format_option(value: object) -> str:
    """Return a value in the spelling that names of methods use; a long one by its length and digest."""
    return str(value).lower() if isinstance(value, bool) else shorten(str(value))


def _input(measure: Any) -> str:
    if wants_halves(measure):
        return "spike counts of the two halves of a window"
    return "the interval texture of a window" if wants_intervals(measure) else "spike counts of a window"


def _read_code(cls: type) -> tuple[tuple[str, str], ...]:
    """Return the name and text, up to MAX_CODE_CHARACTERS, of each readable source file of a class."""
    found = []
    for path in class_source_files(cls):
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            continue
        rest = len(text) - MAX_CODE_CHARACTERS
        found.append((path.name, f"{text[:MAX_CODE_CHARACTERS]}\n# {rest} more characters" if rest > 0 else text))
    return tuple(found)
