"""Scores of windows by a method's measure or by a named one, and what the method pays for them."""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from saf_gen.core.stopwatch import Stopwatch
from saf_gen.errors import BadInput
from saf_gen.parts import wants_frames
from saf_gen.plugins.measures import get_measure
from saf_gen.stream.measure_input import WindowSource, stream_input_for_measure


class TimedWindowSource(WindowSource, Protocol):
    """Windows, and ``textures_s``: seconds in which their textures so far were computed, without reading and counting.

    A texture that was kept counts as long as it took to compute.
    """

    textures_s: float


class MeteredScorer:
    """Scores windows for one method; ``windows`` counts these and what was looked at, ``seconds`` what they took.

    The seconds include the measure and its interval textures, and the search once run_search_of_method has added its
    own time. Counting, reading and encoding are left out, because they stand for the camera: how spikes are
    stored is no merit of a method, and counted windows are shared between methods.
    """

    def __init__(self, measure: Callable[..., float]) -> None:
        self._measure, self._watch = measure, Stopwatch()
        self._named_measures: dict[str, Callable[..., float]] = {}
        self.windows = 0

    @property
    def seconds(self) -> float:
        """Seconds that the method has computed so far."""
        return self._watch.seconds

    def add_seconds(self, seconds: float) -> None:
        """Add time that the method computed outside its scores."""
        self._watch.seconds += seconds

    def look(self, source: WindowSource, *, first: int, stop: int) -> np.ndarray:
        """Return the counts of frames ``first <= t < stop``, uint32 (h, w), read-only."""
        self.windows += 1
        counts = source.window(first, stop)
        counts.flags.writeable = False
        return counts

    def score(self, source: TimedWindowSource, *, first: int, stop: int, measure: str | None = None) -> float:
        """Return the score of frames ``first <= t < stop``, by the method's measure or by a named one.

        Raises BadInput for a window that is not there, for a score that is not a finite number, and for an
        unknown measure.
        """
        if measure is not None and measure not in self._named_measures:
            self._named_measures[measure] = get_measure(measure)
        scorer = self._measure if measure is None else self._named_measures[measure]
        before = source.textures_s
        counts = stream_input_for_measure(source, scorer, first=first, stop=stop)
        self.add_seconds(source.textures_s - before)
        timed: dict[str, Any] = {"frames": int(stop) - int(first)} if wants_frames(scorer) else {}
        self.windows += 1
        score = float(self._watch.time(scorer, counts, **timed))
        if not np.isfinite(score):
            raise BadInput(
                f"{type(scorer).__name__} scores frames {first} to {stop} with {score}",
                allowed="a finite number for any counts",
                hint="a measure gives 0.0 where there is no spike",
            )
        return score
