"""What a method sees of a recording: its length, and the score of any window. The rest is the referee's."""

from collections.abc import Callable
from time import perf_counter

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.parts import wants_halves
from saf_gen.rig.counts import Counts

__all__ = ["Recording"]


class Recording:
    """The handle on a recording that one method's search gets: see saf_gen.parts.View.

    ``frames_seen`` is the end of the latest window asked for, ``windows`` the number of scores asked for,
    ``seconds`` the time the measure took. Counting is not in it: how a stream is stored is no merit of a
    method, and windows already counted are shared.
    """

    def __init__(self, counts: Counts, measure: Callable[[np.ndarray], float]) -> None:
        self._counts, self._measure = counts, measure
        self.frames_seen, self.windows, self.seconds = 0, 0, 0.0

    @property
    def frames(self) -> int:
        """Frames in the recording."""
        return self._counts.frames

    @property
    def now(self) -> int:
        """The end of the latest window asked for."""
        return self.frames_seen

    @property
    def readout_hz(self) -> float:
        """Frames a second."""
        return self._counts.readout_hz

    def position(self, frame: int) -> float:
        """Where the lens was, fraction of the travel; NaN where the stream does not say."""
        lens = self._counts.lens
        return float("nan") if lens is None else float(lens[frame])

    def move(self, to: float) -> None:
        """Raises BadInput: what is recorded is recorded."""
        raise BadInput(
            f"the lens of a recording cannot be moved to {to:g}",
            allowed="searches that estimate on a recording",
            hint="evaluate it with --track closed_loop",
        )

    def score(self, first: int, stop: int) -> float:
        """The measure's score of frames ``first <= t < stop`` (0-based, at least one).

        Raises BadInput for a window outside the recording, and for a score that is no finite number.
        """
        count = self._counts.halves if wants_halves(self._measure) else self._counts.window
        counts = count(first, stop)
        self.windows += 1
        self.frames_seen = max(self.frames_seen, int(stop))
        start = perf_counter()
        score = float(self._measure(counts))
        self.seconds += perf_counter() - start
        if not np.isfinite(score):
            raise BadInput(
                f"{type(self._measure).__name__} scores frames {first} to {stop} with {score}",
                allowed="a finite number for any counts",
                hint="a measure gives 0.0 where there is no spike",
            )
        return score
