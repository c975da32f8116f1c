"""Event-based golden search on events, as the code of its authors runs it."""

import math
from dataclasses import dataclass
from typing import ClassVar

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View

RATIO, SECOND = 0.618, 0.381
"""Width of the two windows, and where the second one begins, as parts of the interval: it ends 0.1 % before its end."""
EVENTS = "er_count"
LONGEST_S = 4000.0


@dataclass(frozen=True)
class GoldenSearchEvents:
    """Event-based golden search, as its authors released it: narrows the events of a sweep to ``threshold_s``.

    ``egs_code`` is what Su et al. made of it for spikes. The released code for events differs from that in six points,
    all of which this search has: the interval goes from event to event, not from frame to frame; the second window
    begins at 0.381 and ends at 0.999 of it; the next interval ends with the first event after the better window; of
    equal scores the earlier window wins; the search stops after the step whose interval is no longer than 1 ms; and
    the answer is the first event in the later half of the last window.

    Windows are whole frames, in which a view counts: an event counts as at its frame. With times rounded down to
    frames, the steps are those of the released code, event by event; times in microseconds move the ends of an
    interval by a few frames, and change the choice only where the scores of both windows are that close. Where the
    later half of a window has no event, the released code may take the answer of the other one; this search takes the
    next event.

    Precede it by ``er_count``, the published rate of events; it uses it to find the first event after a frame, too.
    The trace holds the middle of the interval at each step, in frames from 0. It abstains if there is no event.

    References
    ----------
    Lin et al., "Autofocus for Event Cameras", CVPR 2022, doi:10.1109/CVPR52688.2022.01586, with its released code,
    eleboss/eaf_code.
    """

    threshold_s: float = 0.001

    causal: ClassVar[bool] = False
    measures: ClassVar[tuple[str, ...]] = (EVENTS,)

    def __post_init__(self) -> None:
        if isinstance(self.threshold_s, bool) or not 0 <= self.threshold_s <= LONGEST_S:
            raise BadInput(f"threshold_s is {self.threshold_s!r}", allowed=f"0 to {LONGEST_S:g} seconds")

    def __call__(self, view: View) -> Answer:
        """Return the answer for a recording."""
        first, last = _next_event(view, 0), _last_event(view)
        if first is None or last is None:
            return Answer(None, (), "no events")
        trace = [(first + last) / 2]
        answer = first
        while (width := last - first) > 0:
            delta = width * RATIO
            begins = float(first), first + width * SECOND
            better = 0 if _rate(view, begins[0], width=delta) >= _rate(view, begins[1], width=delta) else 1
            begin = begins[better]
            answer = _next_event(view, math.ceil(begin + delta / 2)) or last
            if width <= self.threshold_s * view.readout_hz:
                break
            end = _next_event(view, math.floor(begin + delta) + 1)
            last = last if end is None else min(end, last)
            first = _next_event(view, max(math.ceil(last - delta), 0)) or 0
            trace.append((first + last) / 2)
        return Answer(float(answer), tuple(trace))


def _rate(view: View, begin: float, *, width: float) -> float:
    """Return the score of the events after ``begin`` and not after ``begin + width``, in frames; 0 without a frame."""
    first, stop = math.floor(begin) + 1, math.floor(begin + width) + 1
    return view.score(first, stop) if first < stop else 0.0


def _next_event(view: View, first: int) -> int | None:
    """Return the first frame with an event, from ``first`` on; None if there is none."""
    step = 1
    while first < view.frames:
        stop = min(first + step, view.frames)
        if view.score(first, stop, EVENTS) > 0:
            if stop - first == 1:
                return first
            step = max((stop - first) // 2, 1)  # it is in here: look at the earlier half
        else:
            first, step = stop, 2 * step
    return None


def _last_event(view: View) -> int | None:
    """Return the last frame with an event; None if there is none."""
    stop, step = view.frames, 1
    while stop > 0:
        first = max(stop - step, 0)
        if view.score(first, stop, EVENTS) > 0:
            if stop - first == 1:
                return first
            step = max((stop - first) // 2, 1)
        else:
            stop, step = first, 2 * step
    return None
