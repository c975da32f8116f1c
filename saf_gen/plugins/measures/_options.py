"""Checks of options that several measures have."""

from math import isfinite

from saf_gen.errors import BadInput


def check_whole_number(key: str, value: object, *, highest: int | None = None, unit: str = "number") -> None:
    """Raise BadInput unless ``value`` is a whole number from 1 to ``highest``, or from 1 up if that is None."""
    whole = isinstance(value, int) and not isinstance(value, bool)
    if not (whole and 1 <= value <= (highest or value)):  # type: ignore[operator]
        bounds = "1 or more" if highest is None else f"1 to {highest}"
        raise BadInput(f"{key} is {value!r}", allowed=f"a whole {unit}, {bounds}")


def check_range(key: str, value: object, *, lowest: float, highest: float, unit: str = "") -> None:
    """Raise BadInput unless ``value`` is a number from ``lowest`` to ``highest``."""
    number = isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
    if not (number and lowest <= value <= highest):  # type: ignore[operator]
        raise BadInput(f"{key} is {value!r}", allowed=f"{lowest:g} to {highest:g}{unit}")


def check_dark_options(dark: float, dark_rms: float) -> None:
    """Raise BadInput unless a camera can have this mean dark rate, with this rms over pixels relative to the mean."""
    check_range("dark", dark, lowest=0, highest=0.5, unit=" spikes per pixel and readout")
    check_range("dark_rms", dark_rms, lowest=0, highest=10, unit=" times the mean dark rate")
