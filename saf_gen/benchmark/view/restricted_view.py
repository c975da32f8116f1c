"""What a search holds: the members of saf_gen.parts.View, and nothing of the referee's."""

from saf_gen.benchmark.view.stopwatch import Stopwatch
from saf_gen.parts import View

__all__ = ["BudgetSpentError", "RestrictedView"]


class BudgetSpentError(Exception):
    """A method asked for more time than it has."""


class RestrictedView:
    """A view with the members that saf_gen.parts.View promises alone, none of which can be set.

    What stands behind it, a recording, a sweep or a camera that is running, has members for the referee:
    where the lens truly was, how long the measure took. Those are out of reach.

    ``within`` takes the time of what stands behind it: what remains of a search's is the search's own.
    """

    __slots__ = ("_view", "_within")

    def __init__(self, view: View, within: Stopwatch) -> None:
        self._view, self._within = view, within

    @property
    def frames(self) -> int:
        """Frames that may be looked at."""
        return self._view.frames

    @property
    def now(self) -> int:
        """Frames that have passed."""
        return self._view.now

    @property
    def readout_hz(self) -> float:
        """Frames a second."""
        return self._view.readout_hz

    @property
    def lag_s(self) -> float:
        """Seconds in which a motion that the position sensor does not see falls to 1/e."""
        return self._view.lag_s

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        """The score of frames ``first <= t < stop``. Raises what the view raises, as all of these do."""
        return self._within.time(self._view.score, first, stop, measure)

    def position(self, frame: int) -> float:
        """Where the lens says it was, fraction of the travel."""
        return self._within.time(self._view.position, frame)

    def move(self, to: float) -> None:
        """Command the lens to ``to``, fraction of the travel."""
        self._within.time(self._view.move, to)

    def wait(self, frames: int) -> None:
        """Let at least so many frames pass."""
        self._within.time(self._view.wait, frames)
