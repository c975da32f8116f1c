"""Check of search options that are numbers in a range."""

from collections.abc import Mapping
from math import isfinite
from typing import Any

from saf_gen.errors import BadInput


def check_numbers(search: Any, most: Mapping[str, float]) -> None:
    """Raise BadInput unless each field named in ``most`` is a finite number from 0 to the value given there."""
    for key, highest in most.items():
        value = getattr(search, key)
        if isinstance(value, bool) or not (isfinite(value) and 0 <= value <= highest):
            raise BadInput(f"{key} is {value!r}", allowed=f"0 to {highest:g}")
