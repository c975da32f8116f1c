"""Lines about jobs, workers and schedulers that have said nothing for long: a run does not wait in silence."""

from collections.abc import Callable
from time import monotonic

TELL_AFTER_S = 45.0
"""Silence after which a line tells of it; another follows each time that the silence has doubled."""


class Silence:
    """How long somebody has said nothing, from now on, and how long it was when that was last told.

    ``notify`` is called with a line of text.
    """

    def __init__(self, notify: Callable[[str], None]) -> None:
        self._notify = notify
        self._heard_s, self._told_s = monotonic(), 0.0

    @property
    def is_long(self) -> bool:
        """True if the silence is long enough to be told."""
        return monotonic() - self._heard_s >= TELL_AFTER_S

    def tell(self, who: str, then: str = "") -> None:
        """Tell who is silent, and what will happen, if the silence is long or has doubled since it was told."""
        silent_s = monotonic() - self._heard_s
        if silent_s >= max(TELL_AFTER_S, 2 * self._told_s):
            self._told_s = silent_s
            facts = f"waiting: {who} has said nothing for {silent_s:.0f} s", then, "Ctrl-C stops"
            self._notify("; ".join(filter(None, facts)))

    def end(self, who: str = "") -> None:
        """Begin anew, because somebody has said something; tell who, if the silence was told."""
        if self._told_s and who:
            self._notify(f"goes on: {who} answers again")
        self._heard_s, self._told_s = monotonic(), 0.0
