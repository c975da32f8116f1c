"""Windows of a fixed number of frames: checks of their length, and their scores over a recording."""

from collections.abc import Mapping
from math import isfinite
from numbers import Integral
from typing import Any

from saf_gen.errors import BadInput
from saf_gen.parts import View


def check_numbers(search: Any, most: Mapping[str, float]) -> None:
    """Raise BadInput unless each field named in ``most`` is a finite number from 0 to the value given there."""
    for key, highest in most.items():
        value = getattr(search, key)
        if isinstance(value, bool) or not (isfinite(value) and 0 <= value <= highest):
            raise BadInput(f"{key} is {value!r}", allowed=f"0 to {highest:g}")


def check_frame_count(key: str, value: object) -> None:
    """Raise BadInput unless ``value`` is a whole number of at least 1."""
    if not isinstance(value, Integral) or isinstance(value, bool) or value < 1:
        raise BadInput(f"{key} is {value!r}", allowed="a whole number of frames, at least 1")


def check_windows_fit(view: View, key: str, *, frames: int) -> None:
    """Raise BadInput if a recording is shorter than ``frames``, the value of the option ``key``."""
    if view.frames < frames:
        raise BadInput(
            f"a recording of {view.frames} frames is shorter than {key}, {frames} frames",
            allowed=f"{key} of 1 ... {view.frames}",
            hint=f"choose a smaller {key}",
        )


def score_windows(view: View, frames: int, *, step: int) -> tuple[range, list[float]]:
    """Return the first frames of all complete windows of a recording, ``step`` apart, and their scores."""
    firsts = range(0, view.frames - frames + 1, step)
    return firsts, [view.score(first, first + frames) for first in firsts]
