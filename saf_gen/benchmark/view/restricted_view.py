"""The boundary between a view and a method: it gives access to the members of View only, and measures the cost."""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from saf_gen.benchmark.view.operations import UNDECLARED, declared_cost
from saf_gen.core.stopwatch import Stopwatch
from saf_gen.errors import BadInput
from saf_gen.parts import View, wants_frames
from saf_gen.plugins.measures import get_measure
from saf_gen.stream.measure_input import Form, WindowSource, measure_input, wanted_form


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

    def polarities(self, first: int, stop: int) -> np.ndarray:
        """Return the events of frames ``first <= t < stop``, falls and then rises; raises what the view raises."""
        return self._within.time(self._view.polarities, first, stop)

    def position(self, frame: int) -> float:
        """Return the lens position that was read at a frame, a fraction of the travel."""
        return self._within.time(self._view.position, frame)

    def move(self, to: float) -> None:
        """Command the lens to ``to``, a fraction of the travel."""
        self._within.time(self._view.move, to)

    def wait(self, frames: int) -> None:
        """Let at least this many frames pass."""
        self._within.time(self._view.wait, frames)


class TimedWindowSource(WindowSource, Protocol):
    """A source of windows that also measures the computing time of interval textures.

    Attributes
    ----------
    textures_s : float
        Computing time of all interval textures so far, in seconds, without reading and counting. A texture that is kept
        from an earlier request counts again with its original time.
    """

    textures_s: float

    def polarities(self, first: int, stop: int) -> np.ndarray:
        """Return the falls, and then the rises, of a window, uint32 (2, h, w); BadInput if these are no events."""
        ...


def no_polarities() -> BadInput:
    """Return the error for a method that asks a camera for polarities which has none."""
    return BadInput(
        "this camera has no events, and so no polarities",
        allowed="polarities of an event camera",
        hint="use view.counts, or record events with saf-gen recapture",
    )


class MeteredScorer:
    """Scores windows for one method, and measures the cost.

    The cost in ``seconds`` is the computing time of the measure and of its interval textures; run_search adds
    the time of the search. Reading, encoding and counting of spikes are excluded: they represent the camera, depend on
    the storage of the spikes rather than on the method, and give windows that methods share.

    Parameters
    ----------
    measure : callable, optional
        The method's own measure; None if the method scores the windows elsewhere.

    Attributes
    ----------
    windows : int
        Number of windows that were scored or looked at.
    operations : float
        Operations of the method so far, as ``cost`` and the measures that it names declare them.
    cost : DeclaredCost
        What the method declares.
    scores : dict of (int, int) to float
        Score of each window (first, stop) by the method's own measure, counted from the first frame of the run.
    """

    def __init__(self, measure: Callable[..., float] | None) -> None:
        self._measures: dict[str | None, Callable[..., float] | None] = {None: measure}
        self._watch = Stopwatch()
        self._extremes: dict[str | None, tuple[float, float]] = {}  # smallest and largest score of each measure
        self._looked = False
        self.windows, self.operations, self.cost = 0, 0.0, UNDECLARED
        self.scores: dict[tuple[int, int], float] = {}

    @property
    def blindness(self) -> str:
        """Why the scores cannot tell one window from another, or ''.

        A method that looked at counts, or that asked for fewer than two scores, is not judged by its scores.
        """
        is_flat = all(low == high for low, high in self._extremes.values())
        return f"all {self.windows} scores are equal" if is_flat and self.windows > 1 and not self._looked else ""

    @property
    def seconds(self) -> float:
        """Computing time of the method so far, in seconds."""
        return self._watch.seconds

    def add_seconds(self, seconds: float) -> None:
        """Add computing time that the method spent outside its scores."""
        self._watch.seconds += seconds

    def image(self, source: TimedWindowSource, form: Form, *, first: int, stop: int) -> np.ndarray:
        """Return frames ``first <= t < stop`` as the measure of a guest is called with them, which scores them there.

        Raises what measure_input raises.
        """
        return self._image(source, form, first=first, stop=stop, cost=self.cost.known().measure)

    def _image(self, source: TimedWindowSource, form: Form, *, first: int, stop: int, cost: float | None) -> np.ndarray:
        """Return a window, and charge for it ``cost`` operations per pixel and those of the search."""
        before = source.textures_s
        image = measure_input(source, form, first=first, stop=stop)
        self.add_seconds(source.textures_s - before)
        self._charge(image, cost=cost)
        return image

    def _charge(self, image: np.ndarray, *, cost: float | None) -> None:
        self.windows += 1
        pixels = image.shape[-2] * image.shape[-1]
        self.operations += pixels * (cost or 0.0) + (self.cost.known().window or 0.0)

    def look(self, source: TimedWindowSource, *, first: int, stop: int) -> np.ndarray:
        """Return the counts of frames ``first <= t < stop``, uint32 (h, w), read-only."""
        self.note_look()
        counts = self._image(source, "counts", first=first, stop=stop, cost=self.cost.known().look)
        counts.flags.writeable = False
        return counts

    def look_at_polarities(self, source: TimedWindowSource, *, first: int, stop: int) -> np.ndarray:
        """Return the events of frames ``first <= t < stop``, falls and then rises: uint32 (2, h, w), read-only.

        They cost as much as counts. Raises BadInput if the source holds no events.
        """
        events = source.polarities(first, stop)
        self.note_look()
        self._charge(events, cost=self.cost.known().look)
        events.flags.writeable = False
        return events

    def note_look(self) -> None:
        """Note that the method looked at counts itself."""
        self._looked = True

    def score(self, source: TimedWindowSource, *, first: int, stop: int, measure: str | None = None) -> float:
        """Return the score of frames ``first <= t < stop`` by the method's measure, or by the one named ``measure``.

        Raises BadInput if the window does not exist, if the score is not a finite number, or if the measure is unknown.
        """
        cost = declared_cost(self._find(measure), None).known().measure
        image = self._image(source, self.form(measure), first=first, stop=stop, cost=cost)
        return self.rate(image, first=first, stop=stop, measure=measure)

    def rate(self, image: np.ndarray, *, first: int, stop: int, measure: str | None = None) -> float:
        """Return the score of the image of frames ``first <= t < stop``; raises BadInput as :meth:`score` does."""
        scorer = self._find(measure)
        timed: dict[str, Any] = {"frames": int(stop) - int(first)} if wants_frames(scorer) else {}
        score = float(self._watch.time(scorer, image, **timed))
        if not np.isfinite(score):
            raise BadInput(
                f"{type(scorer).__name__} scores frames {first} to {stop} with {score}",
                allowed="a finite number for any counts",
                hint="return 0.0 if there is no spike",
            )
        low, high = self._extremes.get(measure, (score, score))
        self._extremes[measure] = min(low, score), max(high, score)
        if measure is None:
            self.scores[int(first), int(stop)] = score
        return score

    def form(self, measure: str | None = None) -> Form:
        """Return what the method's measure, or the one named ``measure``, is called with; BadInput if it is unknown."""
        return wanted_form(self._find(measure))

    def _find(self, measure: str | None) -> Callable[..., float]:
        if measure not in self._measures:
            self._measures[measure] = get_measure(str(measure))
        found = self._measures[measure]
        if found is None:
            raise BadInput("the windows of this method are scored elsewhere")
        return found
