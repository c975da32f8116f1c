"""Conversion of plain functions and classes to plug-ins whose options are their parameters."""

import math
from collections.abc import Callable, Mapping
from dataclasses import field, is_dataclass, make_dataclass
from functools import partial
from inspect import Parameter, isfunction, signature
from typing import Any

import numpy as np

from saf_gen.core.user_code import user_code
from saf_gen.errors import BadInput
from saf_gen.parts import wants_frames, wants_halves

PROTOCOL_METHODS = {"measures": "__call__", "searches": "__call__", "lights": "integral", "motions": "positions"}
DECLARED = "saf_gen_declared"
"""Attribute of a function that holds the declarations of its decorator."""


def wrap_plain_code(found: object, plugin_kind: str) -> type | None:
    """Return a function or class as a plug-in class; None if it cannot be a plug-in of this kind.

    A dataclass is returned unchanged. A class needs the method of its kind (``__call__`` for measures and searches),
    and the parameters of its ``__init__`` become options. A function is a measure or a search: its first parameter is
    its input, and the others become options. The attribute ``plain`` of the plug-in class is the function or class.

    Raises BadInput if the parameters cannot become options.
    """
    if isinstance(found, type):
        if is_dataclass(found):
            return found
        has_method = any(PROTOCOL_METHODS[plugin_kind] in vars(base) for base in found.__mro__)
        return _plugin_of_class(found, plugin_kind) if has_method else None
    if isfunction(found) and plugin_kind in ("measures", "searches"):
        return _plugin_of_function(found, plugin_kind)
    return None


def declare_measure(function: Callable[..., float], **declared: Any) -> None:
    """Attach declarations, such as the degree of a measure, to a function."""
    setattr(function, DECLARED, declared)


def _plugin_of_class(cls: type, plugin_kind: str) -> type:
    options = _list_options(cls)
    names = [name for name, *_ in options]

    initialise: Any = getattr(cls, "__init__")  # noqa: B009  (mypy refuses the attribute)

    def build(self: Any) -> None:
        initialise(self, **{name: getattr(self, name) for name in names})

    added: dict[str, Any] = {"__post_init__": build}
    if plugin_kind == "measures":
        score_plainly: Any = cls.__call__

        def score(self: Any, counts: np.ndarray, **frames: int) -> float:
            return float(score_plainly(self, counts, **frames))

        added["__call__"] = score
    return _make_plugin(cls, plugin_kind, options=options, added=added, bases=(cls,))


def _plugin_of_function(function: Callable[..., Any], plugin_kind: str) -> type:
    declared: Mapping[str, Any] = getattr(function, DECLARED, {})
    length = {"frames"} if declared.get("timed") else set()
    options = [option for option in _list_options(function)[1:] if option[0] not in length]
    names = [name for name, *_ in options]

    def call(self: Any, model_input: Any, **frames: int) -> Any:
        answer = function(model_input, **{name: getattr(self, name) for name in names}, **frames)
        return float(answer) if plugin_kind == "measures" else answer

    return _make_plugin(function, plugin_kind, options=options, added={**declared, "__call__": call}, bases=())


def _list_options(found: Callable[..., Any]) -> list[tuple[str, Any, Any]]:
    """Return the name, type and dataclass field of each parameter that can be given by name."""
    options: list[tuple[str, Any, Any]] = []
    try:
        parameters = signature(found).parameters.values()
    except (TypeError, ValueError) as error:  # such as for a function written in C
        raise BadInput(f"the parameters of {found!r} cannot be read: {error}", hint="wrap it in a function") from error
    for parameter in parameters:
        if parameter.kind in (Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD):
            continue
        required = parameter.default is Parameter.empty
        option_field = field() if required else field(default_factory=partial(_return_default, parameter.default))
        options.append((parameter.name, Any, option_field))
    return options


def _return_default(default: object) -> object:
    """Return a default uncopied, as Python shares the defaults of functions between calls."""
    return default


def _make_plugin(
    plain: Any, plugin_kind: str, *, options: list[tuple[str, Any, Any]], added: Mapping[str, Any], bases: tuple
) -> type:
    stated = {"plain": staticmethod(plain), "__doc__": plain.__doc__, **added}
    defaults: dict[str, Any] = {"causal": False} if plugin_kind == "searches" else {}
    if plugin_kind == "measures":
        defaults = {"degree": property(_find_degree), "score_range": "not stated"}
    stated |= {name: value for name, value in defaults.items() if name not in stated and not hasattr(plain, name)}
    try:
        made = make_dataclass(plain.__name__, options, bases=bases, namespace=stated, eq=False)
    except TypeError as error:  # a parameter without a default follows one that has a default
        raise BadInput(f"{plain.__name__}: {error}", hint="give its parameters defaults") from error
    made.__module__, made.__qualname__ = plain.__module__, plain.__qualname__
    return made


def _find_degree(measure: Any) -> int:
    """Return the power of brightness in a score, found by quadrupling counts; 0 unless it is a positive integer."""
    counts = (np.arange(48 * 64, dtype=np.uint32).reshape(48, 64) * 7919 % 97 % 23 + 1).astype(np.uint32)
    window = np.stack([counts, counts[::-1]]) if wants_halves(measure) else counts
    frames = {"frames": 200} if wants_frames(measure) else {}
    try:
        with user_code():
            one, four = measure(window, **frames), measure(4 * window, **frames)
    except Exception:  # noqa: BLE001  (a user's measure may raise anything, and does so again when it is used)
        return 0
    if not (0 < one < math.inf and 0 < four < math.inf):
        return 0
    degree = math.log(four / one, 4)
    return max(round(degree), 0) if math.isclose(degree, round(degree), abs_tol=1e-6) else 0
