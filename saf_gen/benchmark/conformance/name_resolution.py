"""Resolution of the name given to ``saf-gen methods check``, which may name a method, a measure or a search."""

from inspect import signature
from typing import Any

from saf_gen.benchmark.method_spec import Method, parse_method, parse_options
from saf_gen.core.config.registry import names, plugin_class
from saf_gen.errors import BadInput, unknown
from saf_gen.plugins.measures import get_measure, measure_names
from saf_gen.plugins.searches import get_search, search_names

FORM_SUFFIXES = ("_n", "_tfi")


def resolve_name(spec: str) -> Method | tuple[str, Any]:
    """Return the method of a given name, or the kind (``measures`` or ``searches``) and the plug-in of that name.

    Raises BadInput if nothing has this name, or if the plug-in refuses its options.
    """
    if spec.startswith("@") or "+" in spec:
        return parse_method(spec)
    name, options = parse_options("".join(spec.split()), spec)
    if _find_kind(name) == "searches":
        return "searches", get_search(name, **options)
    return "measures", get_measure(name, **options)


def _find_kind(name: str) -> str:
    if name in names("searches"):
        return "searches"
    bare = name
    while bare.endswith(FORM_SUFFIXES) and bare not in names("measures"):
        bare = next(bare.removesuffix(suffix) for suffix in FORM_SUFFIXES if bare.endswith(suffix))
    if bare in names("measures"):
        return "measures"
    if ":" not in name:
        raise unknown("measure or search", name, allowed=[*measure_names(), *search_names()])
    cls = _load_class(name, bare)
    plain = getattr(cls, "plain", None)
    if plain is not None and not any(hasattr(plain, member) for member in ("degree", "score_range", "halves")):
        return "searches" if _has_view_parameter(plain) else "measures"
    if bare != name or any(hasattr(cls, member) for member in ("degree", "score_range", "halves")):
        return "measures"
    if any(hasattr(cls, member) for member in ("causal", "commands")):
        return "searches"
    raise BadInput(
        f"{name!r} is neither a measure nor a search",
        allowed="a class that states degree (a measure) or causal (a search)",
        hint=f"state one of them, or check a complete method: {name}+argmax",
    )


def _has_view_parameter(plain: Any) -> bool:
    """Return whether one of the first two parameters of a plain function, or of a plain class's calls, is ``view``."""
    called = plain.__call__ if isinstance(plain, type) else plain
    return "view" in list(signature(called).parameters)[:2]


def _load_class(name: str, bare: str) -> type:
    """Return the class called ``name`` or, if it does not exist, the class called ``bare``.

    ``bare`` is ``name`` without the suffixes ``_n`` and ``_tfi``. The full name is tried first, because the name of a
    class may end like this.
    """
    try:
        return plugin_class("measures", name)
    except BadInput:
        if bare == name:
            raise
        return plugin_class("measures", bare)
