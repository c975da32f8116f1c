"""Checks of the keys of motions."""

from math import isfinite
from typing import TypeGuard

from saf_gen.errors import BadInput


def check_motion_position(key: str, value: object) -> None:
    """Raise BadInput, with the key, unless the value is a position in the travel."""
    if not (_is_number(value) and 0 <= value <= 1):
        raise BadInput(f"{key} is {value!r}", allowed="0 to 1, a fraction of the travel")


def check_motion_endpoints(from_: object, to: object) -> None:
    """Raise BadInput unless both values are positions in the travel and differ."""
    check_motion_position("from", from_)
    check_motion_position("to", to)
    if from_ == to:
        raise BadInput(
            f"the lens does not move: from and to are both {to!r}",
            allowed="two positions",
            hint="{kind: hold, position: ...} keeps it at rest",
        )


def check_motion_bounds(key: str, value: object, *, low: float, high: float, unit: str) -> None:
    """Raise BadInput, with the key, unless low < value <= high."""
    if not (_is_number(value) and low < value <= high):
        raise BadInput(f"{key} is {value!r}", allowed=f"above {low:g}, at most {high:g} {unit}".rstrip())


def check_motion_duration(key: str, value: object) -> None:
    """Raise BadInput, with the key, unless the value is a time of 0 s or more."""
    if not (_is_number(value) and isfinite(value) and value >= 0):
        raise BadInput(f"{key} is {value!r}", allowed="seconds, 0 or more")


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)
