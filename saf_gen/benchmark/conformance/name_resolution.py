"""What a name of `saf-gen methods check` means: a whole method, or a half of one."""

from typing import Any

from saf_gen.benchmark.method_spec import Method, parse_method, parse_plugin_options
from saf_gen.core.config.registry import names, plugin_class
from saf_gen.errors import BadInput, unknown
from saf_gen.measures import get_measure, measure_names
from saf_gen.searches import get_search, search_names

__all__ = ["resolve_name"]

PART_LOADERS = {"measures": get_measure, "searches": get_search}
FORM_SUFFIXES = ("_n", "_tfi")


def resolve_name(spec: str) -> Method | tuple[str, Any]:
    """The method of a spec, or the room and the part of a half: a measure or a search with its options.

    Raises BadInput for a name that is neither, and for what the part refuses.
    """
    if spec.startswith("@") or "+" in spec:
        return parse_method(spec)
    name, options = parse_plugin_options("".join(spec.split()), spec)
    room = _room(name)
    return room, PART_LOADERS[room](name, **options)


def _room(name: str) -> str:
    if name in names("searches"):
        return "searches"
    bare = name
    while bare.endswith(FORM_SUFFIXES) and bare not in names("measures"):
        bare = next(bare.removesuffix(twin) for twin in FORM_SUFFIXES if bare.endswith(twin))
    if bare in names("measures") or ":" not in name:
        if bare not in names("measures"):
            raise unknown("measure or search", name, allowed=[*measure_names(), *search_names()])
        return "measures"
    cls = _class(name, bare)
    if bare != name or any(hasattr(cls, says) for says in ("degree", "score_range", "halves")):
        return "measures"
    if any(hasattr(cls, says) for says in ("causal", "commands")):
        return "searches"
    raise BadInput(
        f"{name!r} is neither a measure nor a search",
        allowed="a class that states degree (a measure) or causal (a search)",
        hint=f"state it, or check a whole method: {name}+argmax",
    )


def _class(name: str, bare: str) -> type:
    """The class of ``file.py:Class``; one whose own name ends like a twin's is found first."""
    try:
        return plugin_class("measures", name)
    except BadInput:
        if bare == name:
            raise
        return plugin_class("measures", bare)
