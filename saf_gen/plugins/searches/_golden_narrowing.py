"""Golden search on a recording: as the released code of Su et al. runs it, and without its conventions.

``narrow_golden_interval_as_released`` follows the code: frames are 1-based and inclusive, and the ends of an
interval may be fractional. ``narrow_golden_interval_to_centre`` is this project's: whole frames from 0, windows
first <= t < stop, centres.
"""

import math

from saf_gen.errors import BadInput
from saf_gen.parts import View

RATIO = 0.618
THRESHOLD = 10.0


def check_golden_search_options(threshold: float, ratio: float) -> None:
    """Raise BadInput for a threshold below one frame, and for a ratio with which windows leave a gap."""
    if not (math.isfinite(threshold) and threshold >= 1):
        raise BadInput(f"threshold is {threshold!r}", allowed="frames, a number of at least 1")
    if not 0.5 <= ratio < 1:
        raise BadInput(f"ratio is {ratio!r}", allowed="0.5 up to but not 1, so that the two windows cover the interval")


def check_search_recording_length(view: View, threshold: float, *, longest_refused: float) -> None:
    """Raise BadInput for a recording in which no window would be scored: its middle would be the answer."""
    if view.frames <= longest_refused:
        raise BadInput(
            f"a recording of {view.frames} frames is too short for threshold {threshold:g}",
            allowed=f"more than {longest_refused:g} frames",
            hint="choose a smaller threshold",
        )


def count_search_blocks(view: View, dt: int) -> tuple[int, int]:
    """Return the block with which a golden fast search begins, from 1, and the number of blocks.

    Raises BadInput where the recording holds no block of ``dt`` frames, or too few frames in its first
    quarter to divide them in two.
    """
    blocks = view.frames // dt
    first = max(math.ceil(blocks / 4), 1)
    if blocks < 1 or first * dt < 3:
        raise BadInput(
            f"a recording of {view.frames} frames is too short for blocks of {dt} frames",
            allowed="at least one block, and three frames in the first quarter",
            hint="choose another dt",
        )
    return first, blocks


def golden_search_feedback(view: View, end: int) -> float:
    """Return the score of the later half of the first ``end`` frames less that of the earlier half.

    The windows are those of the released code, 1-based and inclusive: h−1 ... end and 1 ... h−1 with h = ⌊(end + 1)/2⌋.
    """
    half = (end + 1) // 2
    return view.score(half - 2, end) - view.score(0, half - 1)


def narrow_golden_interval_as_released(
    view: View, left: float, *, right: float, threshold: float = THRESHOLD, ratio: float = RATIO
) -> tuple[int, ...]:
    """Narrow the interval ``left`` ... ``right`` until it is no wider than ``threshold``.

    Each step scores two windows of ``ratio`` of the interval, at its two ends, and keeps the left one where
    its score is larger, else the right one. Returns the midpoint before the first step and after each.
    """
    trace = [math.floor((left + right) / 2)]
    while right - left > threshold:
        width = right - left
        inner_right, inner_left = left + ratio * width, right - ratio * width
        if _score_inclusive(view, left, last=inner_right) > _score_inclusive(view, inner_left, last=right):
            right = inner_right
        else:
            left = inner_left
        trace.append(math.floor((left + right) / 2))
    return tuple(trace)


def narrow_golden_interval_to_centre(
    view: View, first: int, *, stop: int, threshold: float = THRESHOLD, ratio: float = RATIO
) -> tuple[float, ...]:
    """Narrow the frames ``first <= t < stop`` until no more than ``threshold`` are left.

    Each step scores two windows of ``ratio`` of the interval, at its two ends, and keeps the better. Where
    both score the same, as much is cut off at either end, so that a recording played backwards gives the
    mirrored answer. Returns the centre before the first step and after each, frames from 0.
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


def _score_inclusive(view: View, first: float, *, last: float) -> float:
    """Return the score of the 1-based frames round-half-up(first + j), j = 0 ... ⌊last − first⌋."""
    start = math.floor(first + 0.5)
    return view.score(start - 1, start + math.floor(last - first))
