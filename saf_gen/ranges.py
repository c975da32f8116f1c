"""Numbers left open in a recipe: ``{uniform: [a, b]}``, ``{log_uniform: [a, b]}``, ``{choice: [...]}``.

A draw takes a generator named by sequence and key, so one drawn value never moves another.
"""

from typing import Any

import numpy as np

from saf_gen.errors import BadInput

__all__ = ["draw", "ends", "is_range"]

KINDS = ("uniform", "log_uniform", "choice")


def is_range(value: Any) -> bool:
    """Whether a value is one of the three forms."""
    return isinstance(value, dict) and len(value) == 1 and next(iter(value)) in KINDS


def _parts(value: dict[str, Any], where: str) -> tuple[str, list[Any]]:
    kind, among = next(iter(value.items()))
    if kind == "choice":
        if not isinstance(among, list) or not among:
            raise BadInput(f"choice is {among!r}", where=where, allowed="a list of at least one value")
        return kind, among
    numbers = isinstance(among, list) and all(isinstance(n, int | float) for n in among)
    if not numbers or len(among) != 2 or not among[0] < among[1] or (kind == "log_uniform" and among[0] <= 0):
        positive = ", both above 0" if kind == "log_uniform" else ""
        raise BadInput(f"{kind} is {among!r}", where=where, allowed=f"[low, high] with low < high{positive}")
    return kind, among


def ends(value: Any, *, where: str = "") -> list[Any]:
    """The extreme values of a range (all of a choice), to check before anything is drawn."""
    return _parts(value, where)[1] if is_range(value) else [value]


def draw(value: Any, random: np.random.Generator, *, where: str = "") -> Any:
    """One value of a range; a fixed value is returned as it is."""
    if not is_range(value):
        return value
    kind, among = _parts(value, where)
    if kind == "choice":
        return among[int(random.integers(len(among)))]
    low, high = among
    share = random.random()
    drawn = low + (high - low) * share if kind == "uniform" else low * (high / low) ** share
    return float(f"{drawn:.12g}")  # a power's last digits differ between machines, and digests would see it
