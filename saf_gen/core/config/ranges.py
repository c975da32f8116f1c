"""Numbers that a recipe leaves open: ``{uniform: [a, b]}``, ``{log_uniform: [a, b]}``, ``{choice: [...]}``.

Each value is drawn from its own generator, named by sequence and key, so no draw changes another.
"""

import sys
from datetime import date
from math import isfinite
from typing import Any

import numpy as np

from saf_gen.errors import BadInput, closest

RANGE_FORMS = ("uniform", "log_uniform", "choice")
PLAIN_VALUES = "a finite number, text, true or false, or a list of them"


def is_number(value: Any) -> bool:
    """Return whether a value is a number that float64 can hold; true and false are not numbers."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def is_range(value: Any) -> bool:
    """Return whether a value has one of the three forms of a range."""
    return isinstance(value, dict) and len(value) == 1 and next(iter(value)) in RANGE_FORMS


def _form_and_values(value: dict[str, Any], where: str) -> tuple[str, list[Any]]:
    """Return the form of a range and its list of values, after checking them."""
    kind, among = next(iter(value.items()))
    if kind == "choice":
        if not isinstance(among, list) or not among:
            raise BadInput(f"choice is {among!r}", where=where, allowed="a list of at least one value")
        for value in among:
            if is_range(value):
                raise BadInput(f"a choice holds the range {value!r}", where=where, allowed="plain values")
        return kind, among
    log = kind == "log_uniform"
    fit = isinstance(among, list) and len(among) == 2 and all(is_number(n) for n in among)
    fit = fit and among[0] < among[1] and (among[0] > 0 or not log)
    if not (fit and isfinite(among[1] / among[0] if log else float(among[1]) - float(among[0]))):
        allowed = f"[low, high] with low < high{', both above 0' if log else ''}, finite numbers"
        raise BadInput(f"{kind} is {among!r}", where=where, allowed=allowed)
    return kind, among


def check_parameter(value: Any, *, what: str = "the value", where: str = "") -> None:
    """Raise BadInput for a parameter that is neither a plain value nor a range of plain values.

    Finite numbers, text, true, false and lists of these are plain. A YAML date or ``.nan`` is not, because it could not
    be stored with the recording.
    """
    for end in range_extremes(value, where=where):
        for one in end if isinstance(end, list) else [end]:
            if not (is_number(one) or isinstance(one, str | bool)):
                forms = ", ".join(f"{{{kind}: [...]}}" for kind in RANGE_FORMS)
                near = closest(next(iter(one)), RANGE_FORMS) if isinstance(one, dict) and one else ""
                raise BadInput(
                    f"{what} is {_describe(one)}", where=where, allowed=f"{PLAIN_VALUES}; or {forms}", nearest=near
                )


def range_extremes(value: Any, *, where: str = "") -> list[Any]:
    """Return both ends of a range, or all values of a choice, so that they can be checked before anything is drawn.

    For a fixed value the list holds only this value. Raises BadInput for a range from which nothing can be drawn.
    """
    return _form_and_values(value, where)[1] if is_range(value) else [value]


def draw_range(value: Any, random: np.random.Generator, *, where: str = "") -> Any:
    """Return a value drawn from a range; a fixed value is returned unchanged."""
    if not is_range(value):
        return value
    kind, among = _form_and_values(value, where)
    if kind == "choice":
        return among[int(random.integers(len(among)))]
    low, high = among
    fraction = random.random()
    drawn = low + (high - low) * fraction if kind == "uniform" else low * (high / low) ** fraction
    return float(f"{drawn:.12g}")  # the last digits of a power differ between machines, and would change digests


def _describe(value: Any) -> str:
    return "empty" if value is None else f"the date {value}" if isinstance(value, date) else repr(value)
