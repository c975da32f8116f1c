"""Checks of the options of lens motions."""

from math import isfinite
from typing import TypeGuard

from saf_gen.errors import BadInput


def check_position(key: str, value: object) -> None:
    """Raise BadInput, naming ``key``, unless ``value`` is a fraction of the travel, 0 to 1."""
    if not (_is_number(value) and 0 <= value <= 1):
        raise BadInput(f"{key} is {value!r}", allowed="0 to 1, a fraction of the travel")


def check_endpoints(from_: object, to: object) -> None:
    """Raise BadInput unless the values are two different fractions of the travel, 0 to 1."""
    check_position("from", from_)
    check_position("to", to)
    if from_ == to:
        raise BadInput(
            f"the lens does not move: from and to are both {to!r}",
            allowed="two different positions",
            hint="use {kind: hold, position: ...} for a lens at rest",
        )


def check_bounds(key: str, value: object, *, low: float, high: float, unit: str) -> None:
    """Raise BadInput, naming ``key``, unless ``low < value <= high``."""
    if not (_is_number(value) and low < value <= high):
        raise BadInput(f"{key} is {value!r}", allowed=f"above {low:g}, at most {high:g} {unit}".rstrip())


def check_duration(key: str, value: object) -> None:
    """Raise BadInput, naming ``key``, unless ``value`` is a finite time of 0 s or more."""
    if not (_is_number(value) and isfinite(value) and value >= 0):
        raise BadInput(f"{key} is {value!r}", allowed="seconds, 0 or more")


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)
