"""Golden search on a recording: as the paper's released code runs it, and without its conventions.

``narrow_as_released`` is the code's: frames are 1-based and inclusive, the ends of an interval may be
fractional. ``narrow_to_centre`` is ours: whole frames from 0, windows first <= t < stop, centres.
"""

import math
from numbers import Integral

from saf_gen.errors import BadInput
from saf_gen.parts import View

__all__ = [
    "RATIO",
    "THRESHOLD",
    "check_frame_count",
    "check_narrowing",
    "half_score_difference",
    "midpoint",
    "narrow_as_released",
    "narrow_to_centre",
]

RATIO = 0.618
THRESHOLD = 10.0


def check_frame_count(value: object, name: str) -> int:
    """``value`` as an int. Raises BadInput, naming the key, unless it is a whole number of at least 1."""
    if not isinstance(value, Integral) or isinstance(value, bool) or value < 1:
        raise BadInput(f"{name} is {value!r}", allowed="a whole number of frames, at least 1")
    return int(value)


def check_narrowing(threshold: float, ratio: float) -> None:
    """Raises BadInput for a threshold below one frame, and for a ratio with which windows leave a gap."""
    if not (math.isfinite(threshold) and threshold >= 1):
        raise BadInput(f"threshold is {threshold!r}", allowed="frames, a number of at least 1")
    if not 0.5 <= ratio < 1:
        raise BadInput(
            f"ratio is {ratio!r}",
            allowed="0.5 up to but not 1, so that the two windows cover the interval",
        )


def midpoint(left: float, right: float) -> int:
    """The 1-based frame that an interval stands for."""
    return math.floor((left + right) / 2)


def narrow_as_released(
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


def half_score_difference(view: View, end: int) -> float:
    """What a golden fast search follows: the score of the later half of ``end`` frames less the earlier's.

    The released code's two windows, 1-based and inclusive: h−1 ... end and 1 ... h−1, h = ⌊(end + 1)/2⌋.
    """
    half = (end + 1) // 2
    return view.score(half - 2, end) - view.score(0, half - 1)


def narrow_to_centre(
    view: View, first: int, *, stop: int, threshold: float = THRESHOLD, ratio: float = RATIO
) -> tuple[float, ...]:
    """Narrow the frames ``first <= t < stop`` until no more than ``threshold`` are left.

    Each step scores two windows of ``ratio`` of the interval, at its two ends, and keeps the better. Equal
    scores do not say which: as much is cut off at either end, so that a recording played backwards gives the
    same place. Returns the centre before the first step and after each, frames from 0.
    """
    trace = [(first + stop - 1) / 2]
    while stop - first > threshold:
        width = stop - first
        kept = min(max(round(ratio * width), 1), width - 1)
        earlier, later = view.score(first, first + kept), view.score(stop - kept, stop)
        if earlier == later:
            cut = (width - kept) // 2
            if cut == 0:
                break
            first, stop = first + cut, stop - cut
        elif earlier > later:
            stop = first + kept
        else:
            first = stop - kept
        trace.append((first + stop - 1) / 2)
    return tuple(trace)


def _score(view: View, a: float, b: float) -> float:
    """Score of the window a ... b, which takes the frames round-half-up(a + j), j = 0 ... ⌊b − a⌋."""
    first = math.floor(a + 0.5)
    return view.score(first - 1, first + math.floor(b - a))
