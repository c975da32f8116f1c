"""Scores of windows by a method's measure, or by a named one, and the bill of it."""

from collections.abc import Callable
from typing import Any

import numpy as np

from saf_gen.benchmark.view.stopwatch import Stopwatch
from saf_gen.benchmark.view.window_counts import WindowSource, measure_input
from saf_gen.errors import BadInput
from saf_gen.measures import get_measure
from saf_gen.parts import wants_frames

__all__ = ["MeteredScorer"]


class MeteredScorer:
    """What one method pays: ``windows`` is the number of scores asked for, ``seconds`` what it computed.

    The time of the measure, and of the textures that it asks for, is added here; that of the search by who
    runs it (:func:`saf_gen.benchmark.tracks.search_run.asked`). Counting, reading and encoding are not in
    it: they stand
    for the camera, how spikes are stored is no merit of a method, and counted windows are shared.
    """

    def __init__(self, measure: Callable[..., float]) -> None:
        self._measure, self._watch = measure, Stopwatch()
        self._others: dict[str, Callable[..., float]] = {}
        self.windows = 0

    @property
    def seconds(self) -> float:
        """What the method computed so far."""
        return self._watch.seconds

    def add_seconds(self, seconds: float) -> None:
        """Put on the bill what the method computed beside its scores."""
        self._watch.seconds += seconds

    def score(self, seen: WindowSource, first: int, stop: int, measure: str | None = None) -> float:
        """The score of frames ``first <= t < stop`` of what is seen, by the measure or a named one.

        Raises BadInput for a window that is not there, for a score that is no finite number, and for an
        unknown measure.
        """
        part = self._measure if measure is None else self._named(measure)
        before = seen.textures_s
        counts = measure_input(seen, part, first, stop)
        self.add_seconds(seen.textures_s - before)
        more: dict[str, Any] = {"frames": int(stop) - int(first)} if wants_frames(part) else {}
        self.windows += 1
        score = float(self._watch.time(part, counts, **more))
        if not np.isfinite(score):
            raise BadInput(
                f"{type(part).__name__} scores frames {first} to {stop} with {score}",
                allowed="a finite number for any counts",
                hint="a measure gives 0.0 where there is no spike",
            )
        return score

    def _named(self, measure: str) -> Callable[..., float]:
        if measure not in self._others:
            self._others[measure] = get_measure(measure)
        return self._others[measure]
