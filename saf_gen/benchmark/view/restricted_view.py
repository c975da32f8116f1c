"""Wrapper that gives a search access to the members of saf_gen.parts.View and to nothing else."""

import numpy as np

from saf_gen.core.stopwatch import Stopwatch
from saf_gen.parts import View


class BudgetSpentError(Exception):
    """Error for a method that asks for more frames than its budget has left."""


class RestrictedView:
    """A view that is reduced to the members of :class:`saf_gen.parts.View`, none of which can be set.

    The recording, sweep or running camera behind it has members for the evaluator, such as the true lens position and
    the time of the measure. A search cannot access those.

    Parameters
    ----------
    view : View
        Recording, sweep or running camera.
    within : Stopwatch
        Measures the time that is spent inside the view, which the search is not charged for.
    """

    __slots__ = ("_view", "_within")

    def __init__(self, view: View, within: Stopwatch) -> None:
        self._view, self._within = view, within

    @property
    def frames(self) -> int:
        """Number of frames that may be looked at."""
        return self._view.frames

    @property
    def now(self) -> int:
        """Number of frames that have passed."""
        return self._view.now

    @property
    def readout_hz(self) -> float:
        """Frames per second."""
        return self._view.readout_hz

    @property
    def lag_s(self) -> float:
        """Time constant, in seconds, of a lens motion that the position sensor does not see."""
        return self._view.lag_s

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        """Return the score of frames ``first <= t < stop``; raises what the view raises."""
        return self._within.time(self._view.score, first, stop, measure)

    def counts(self, first: int, stop: int) -> np.ndarray:
        """Return the spike counts of frames ``first <= t < stop``; raises what the view raises."""
        return self._within.time(self._view.counts, first, stop)

    def position(self, frame: int) -> float:
        """Return the lens position that was read at a frame, a fraction of the travel."""
        return self._within.time(self._view.position, frame)

    def move(self, to: float) -> None:
        """Command the lens to ``to``, a fraction of the travel."""
        self._within.time(self._view.move, to)

    def wait(self, frames: int) -> None:
        """Let at least this many frames pass."""
        self._within.time(self._view.wait, frames)
