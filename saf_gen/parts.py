"""What a part looks like from outside: light schedules, lens motions, focus measures, searches.

A part is structural: a frozen dataclass with these members, importing nothing of saf_gen but the ground
floor. The rooms ``lights``, ``motions``, ``measures`` and ``searches`` call parts only through what stands
here.
"""

import re
from dataclasses import dataclass
from inspect import cleandoc
from typing import Protocol

import numpy as np

__all__ = [
    "Answer",
    "Light",
    "Measure",
    "Motion",
    "Search",
    "View",
    "cite_source",
    "commands",
    "wants_frames",
    "wants_halves",
    "wants_intervals",
    "wants_measures",
]


class Light(Protocol):
    """A light schedule: the gain of a light over time, in its own unit of time, the second.

    Two fields mean something to a recipe (:mod:`saf_gen.lights._schedule`). ``seed``, a whole number: names
    the
    part's random stream; a sequence fills in one of its own. ``file``: a path in the recipe, which reads it
    and hands over ``{"path": ..., "text": ...}``.
    """

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Integral of the gain from 0 to each time (0...duration_s), float64, gain seconds.

        The camera integrates light over a readout, so a schedule is given by its antiderivative: the mean
        gain of a readout is then exact, for steps and flicker too.
        """
        ...


class Motion(Protocol):
    """How the lens moves over a recording."""

    def positions(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Where the lens is at each time (0...duration_s), float64 like ``seconds``, 0...1 of the travel.

        Raises BadInput where the motion does not fit a recording of ``duration_s`` seconds.
        """
        ...


class Measure(Protocol):
    """A focus measure: spike counts (row, col) in, one number out; larger is sharper.

    A measure with the class attribute ``halves = True`` compares the two halves of a window. It gets the
    counts of both, (2, row, col): the first of n frames' n // 2, and the rest. One with ``intervals = True``
    gets float64 (row, col) in place of counts: what the window would count at the rate of the one interval
    between spikes round its middle. One with ``timed = True`` is told how long a window was, in frames, as
    ``frames=n``; it must do without, too.

    One may say what it costs: ``cost``, a float, the additions, multiplications and roots (one each) that a
    score takes, over the pixels of its box, borders aside; for 400 x 250 where that matters.
    """

    @property
    def degree(self) -> int:
        """Power of brightness in the score: counts times a give the score times a**degree."""
        ...

    def __call__(self, counts: np.ndarray) -> float: ...


def wants_frames(measure: object) -> bool:
    """Whether a focus measure asks how many frames a window has, as ``frames=n`` beside the counts."""
    return bool(getattr(measure, "timed", False))


def wants_halves(measure: object) -> bool:
    """Whether a focus measure asks for the counts of both halves of a window, (2, row, col)."""
    return bool(getattr(measure, "halves", False))


def wants_intervals(measure: object) -> bool:
    """Whether a focus measure asks for the texture from intervals in place of counts."""
    return bool(getattr(measure, "intervals", False))


class View(Protocol):
    """The handle that a search gets, on a recording or on a camera that is running. Truth is out of reach.

    Frames are 0-based readouts. On a recording every frame is there at once. Live, a window that ends after
    ``now`` makes the camera run until then, and the lens moves on meanwhile.
    """

    @property
    def frames(self) -> int:
        """Frames that may be looked at: the recording's length; live, the budget."""
        ...

    @property
    def now(self) -> int:
        """Frames that have passed: live, the time; of a recording, the end of the latest window looked at."""
        ...

    @property
    def readout_hz(self) -> float:
        """Frames a second."""
        ...

    @property
    def lag_s(self) -> float:
        """Seconds in which a motion of the lens that its position sensor does not see falls to 1/e.

        What the maker of a camera knows of its drive: 0 where the sensor reads the lens, and on a recording.
        """
        ...

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        """The score of the counts in frames ``first <= t < stop`` (at least one).

        By the method's measure, or by another of that name: see :func:`wants_measures`.
        """
        ...

    def position(self, frame: int) -> float:
        """Where the lens says it was at a frame that has passed, fraction of the travel.

        Live it is what the drive's position sensor reads, noise and all. NaN where it is not recorded.
        """
        ...

    def move(self, to: float) -> None:
        """Command the lens to ``to``, fraction of the travel; returns at once, and the next frames see it go.

        Raises BadInput on a recording, and for a place outside the travel.
        """
        ...

    def wait(self, frames: int) -> None:
        """Let time pass without a look: at least ``frames`` more frames (some cameras hand over packets).

        Raises BadInput on a recording. More frames than are left end the run: compare ``now`` with
        ``frames``.
        """
        ...


def commands(search: object) -> bool:
    """Whether a search commands the lens (class attribute ``commands = True``): it needs a running camera."""
    return bool(getattr(search, "commands", False))


def wants_measures(search: object) -> tuple[str, ...]:
    """Focus measures that a search looks through beside the method's own, by name (its ``measures``)."""
    return tuple(getattr(search, "measures", ()))


def cite_source(plug_in: object) -> str:
    """Return where a plug-in comes from, in one line; '' where it does not say.

    A text ``source`` says so, or the section References of the docstring, as numpydoc has it.
    """
    source = getattr(plug_in, "source", None)
    if isinstance(source, str):
        return source.strip()
    _, _, after = cleandoc(plug_in.__doc__ or "").partition("\nReferences\n----------\n")
    references = re.split(r"\n\w+\n-+\n", after)[0]
    return " ".join(references.replace(".. [", "[").split())


@dataclass(frozen=True)
class Answer:
    """Where a search says the focus is.

    ``frame`` is 0-based and may be fractional (the centre of a block of frames a...b-1 is (a+b-1)/2). A
    search that commands the lens answers with ``position`` instead, fraction of the travel. With neither it
    abstains. ``trace`` holds the steps on the way in the search's own convention, ``note`` one line of what
    a reader should know (why it abstained, where it stopped).
    """

    frame: float | None = None
    trace: tuple[float, ...] = ()
    note: str = ""
    position: float | None = None


class Search(Protocol):
    """A search looks at windows through a view, and answers with a frame, or with a place for the lens."""

    def __call__(self, view: View) -> Answer: ...
