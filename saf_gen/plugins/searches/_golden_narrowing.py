"""Golden search on a recording, with and without the conventions of the code that Su et al. released.

``narrow_as_released`` follows the released code: frames count from 1, intervals include their last
frame, and the ends of an interval may be fractional. ``narrow_to_centre`` is this project's version:
frames are whole numbers from 0, windows are first <= t < stop, and results are centres.
"""

import math

from saf_gen.errors import BadInput
from saf_gen.parts import View

RATIO = 0.618
THRESHOLD = 10.0


def check_golden_options(threshold: float, ratio: float) -> None:
    """Raise BadInput if the threshold is below one frame, or if two windows of this ratio would leave a gap."""
    if not (math.isfinite(threshold) and threshold >= 1):
        raise BadInput(f"threshold is {threshold!r}", allowed="frames, a number of at least 1")
    if not 0.5 <= ratio < 1:
        raise BadInput(f"ratio is {ratio!r}", allowed="0.5 up to but not 1, so that the two windows cover the interval")


def check_length(view: View, threshold: float, *, longest_refused: float) -> None:
    """Raise BadInput if a recording is so short that no window would be scored and its middle would be the answer."""
    if view.frames <= longest_refused:
        raise BadInput(
            f"a recording of {view.frames} frames is too short for threshold {threshold:g}",
            allowed=f"more than {longest_refused:g} frames",
            hint="choose a smaller threshold",
        )


def count_blocks(view: View, dt: int) -> tuple[int, int]:
    """Return the block with which a golden fast search begins, counted from 1, and the number of blocks.

    Raises BadInput if the recording has no block of ``dt`` frames, or if its first quarter has too few frames to be
    divided in two.
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


def golden_feedback(view: View, end: int) -> float:
    """Return the score of the later half of the first ``end`` frames minus the score of the earlier half.

    The windows are those of the released code: frames h−1 to end and frames 1 to h−1, both inclusive and counted from
    1, with h = ⌊(end + 1)/2⌋.
    """
    half = (end + 1) // 2
    return view.score(half - 2, end) - view.score(0, half - 1)


def narrow_as_released(
    view: View, left: float, *, right: float, threshold: float = THRESHOLD, ratio: float = RATIO
) -> tuple[int, ...]:
    """Narrow the interval ``left`` ... ``right`` until it is no wider than ``threshold``.

    Each step scores two windows at the two ends of the interval, each ``ratio`` of its width. It keeps the left window
    if its score is larger, otherwise the right one. Returns the midpoint before the first step and after each step,
    rounded down.
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


def narrow_to_centre(
    view: View, first: int, *, stop: int, threshold: float = THRESHOLD, ratio: float = RATIO
) -> tuple[float, ...]:
    """Narrow the frames ``first <= t < stop`` until no more than ``threshold`` are left.

    Each step scores two windows at the two ends of the interval, each ``ratio`` of its width, and keeps the better one.
    If both score the same, the same number of frames is cut off at each end, so that a recording played backwards gives
    the mirrored answer. Returns the centre before the first step and after each step, in frames from 0.
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
    """Return the score of the frames round-half-up(first + j), j = 0 ... ⌊last − first⌋, counted from 1."""
    start = math.floor(first + 0.5)
    return view.score(start - 1, start + math.floor(last - first))
