"""The interval search that the paper's released code ends in, and its way of naming windows.

Frames are 1-based and inclusive here, as in that code; the ends of an interval may be fractional.
"""

import math
from numbers import Integral

from saf_gen.errors import BadInput
from saf_gen.parts import View

__all__ = ["RATIO", "THRESHOLD", "midpoint", "narrow", "whole"]

RATIO = 0.618
THRESHOLD = 10.0


def whole(value: object, name: str) -> int:
    """``value`` as an int. Raises BadInput, naming the key, unless it is a whole number of at least 1."""
    if not isinstance(value, Integral) or isinstance(value, bool) or value < 1:
        raise BadInput(f"{name} is {value!r}", allowed="a whole number of frames, at least 1")
    return int(value)


def midpoint(left: float, right: float) -> int:
    """The 1-based frame that an interval stands for."""
    return math.floor((left + right) / 2)


def narrow(
    view: View, left: float, *, right: float, threshold: float = THRESHOLD, ratio: float = RATIO
) -> tuple[int, ...]:
    """Narrow the interval ``left`` ... ``right`` until it is no wider than ``threshold``.

    Each step scores two windows of ``ratio`` of the interval, at its two ends, and keeps the left one where
    its score is larger, else the right one. Returns the midpoint before the first step and after each.
    """
    trace = [midpoint(left, right)]
    while right - left > threshold:
        width = right - left
        inner_right, inner_left = left + ratio * width, right - ratio * width
        if _score(view, left, inner_right) > _score(view, inner_left, right):
            right = inner_right
        else:
            left = inner_left
        trace.append(midpoint(left, right))
    return tuple(trace)


def _score(view: View, a: float, b: float) -> float:
    """Score of the window a ... b, which takes the frames round-half-up(a + j), j = 0 ... ⌊b − a⌋."""
    first = math.floor(a + 0.5)
    return view.score(first - 1, first + math.floor(b - a))
