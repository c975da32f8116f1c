"""Protocols of the plug-ins: light schedules, lens motions, focus measures and searches.

A plug-in is a frozen dataclass with the members of its protocol; it need not inherit from it. It imports
nothing of saf_gen but :mod:`saf_gen.core`, :mod:`saf_gen.errors` and this module, and saf_gen uses nothing
of it but what is described here.
"""

import re
from dataclasses import dataclass
from inspect import cleandoc
from typing import Protocol

import numpy as np


class Light(Protocol):
    """A light schedule: the gain of a light group over the time of a recording.

    Two fields have a meaning to recipes: ``seed``, a whole number, names the random stream of the schedule,
    and each sequence has its own where the recipe gives none; ``file`` is a path in a recipe, which reads the
    file and hands over ``{"path": ..., "text": ...}``.
    """

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the integral of the gain from 0 to each time.

        A pixel integrates light over a readout, so a schedule is described by its antiderivative: the mean
        gain of a readout is then exact, for steps and flicker too.

        Parameters
        ----------
        seconds : float64 array, any shape
            Times in s, 0...duration_s.
        duration_s : float
            Length of the recording in s, above 0.

        Returns
        -------
        float64 array of the shape of ``seconds``
            Gain times seconds.
        """
        ...


class Motion(Protocol):
    """A motion of the lens over a recording; fields ``seed`` and ``file`` are as in :class:`Light`."""

    def positions(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the position of the lens at each time.

        Parameters
        ----------
        seconds : float64 array, any shape
            Times in s, 0...duration_s.
        duration_s : float
            Length of the recording in s, above 0.

        Returns
        -------
        float64 array of the shape of ``seconds``
            Fraction of the travel, 0...1.

        Raises
        ------
        BadInput : where the motion does not fit a recording of this length.
        """
        ...


class Measure(Protocol):
    """A focus measure: a number for the spike counts of a window, larger where the picture is sharper.

    Class attributes, all optional, say what it wants and what it costs:

    halves : bool
        It compares the two halves of a window, and gets the counts of both, (2, row, col): those of the first
        ``n // 2`` of n frames, and those of the rest.
    intervals : bool
        In place of counts it gets float64 (row, col): what the window would count at the rate of the one
        interval between spikes at its middle.
    timed : bool
        It gets the length of the window in frames as ``frames=n``; it must work without it, too.
    cost : float
        Additions, multiplications and roots (one each) per score, divided by the pixels of its box, borders
        aside; for 400 x 250 pixels where that matters.
    """

    @property
    def degree(self) -> int:
        """The power of brightness in the score: counts multiplied by a multiply the score by ``a**degree``."""
        ...

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of the counts, uint32 (row, col) of the region, at least one pixel."""
        ...


def wants_frames(measure: object) -> bool:
    """Return whether a focus measure takes the length of a window as ``frames=n`` (``timed``)."""
    return bool(getattr(measure, "timed", False))


def wants_halves(measure: object) -> bool:
    """Return whether a focus measure takes the counts of both halves of a window (``halves``)."""
    return bool(getattr(measure, "halves", False))


def wants_intervals(measure: object) -> bool:
    """Return whether a focus measure takes the texture from intervals in place of counts (``intervals``)."""
    return bool(getattr(measure, "intervals", False))


class View(Protocol):
    """What a search sees: a recording, or a camera that is running. The true focus is out of reach.

    Frames are readouts, counted from 0. All frames of a recording are available at once. In a closed-loop run a window
    that ends after ``now`` makes the camera run until its end, and the lens moves on meanwhile.
    """

    @property
    def frames(self) -> int:
        """The number of frames that may be used: the length of the recording, or the budget of a closed-loop run."""
        ...

    @property
    def now(self) -> int:
        """The number of frames that have passed; on a recording, the end of the latest window used."""
        ...

    @property
    def readout_hz(self) -> float:
        """Frames per second."""
        ...

    @property
    def lag_s(self) -> float:
        """Seconds in which a motion of the lens that its position sensor does not see falls to 1/e.

        It is part of a drive's data sheet: 0 where the sensor reads the lens itself, and on a recording.
        """
        ...

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        """Return the score of the counts in frames ``first <= t < stop``.

        Parameters
        ----------
        first, stop : int
            A window of at least one frame, 0 <= first < stop <= ``frames``.
        measure : str, optional
            A focus measure of this name in place of the method's own, one of :func:`wants_measures`.
        """
        ...

    def counts(self, first: int, stop: int) -> np.ndarray:
        """Return the spike counts of frames ``first <= t < stop`` in the region: uint32 (row, col), read-only.

        For a search that looks at pictures, such as a network; it takes the time that ``score`` takes.
        """
        ...

    def position(self, frame: int) -> float:
        """Return the lens position at a frame that has passed, fraction of the travel; NaN where unknown.

        In a closed-loop run it is the reading of the drive's position sensor, with its noise.
        """
        ...

    def move(self, to: float) -> None:
        """Command the lens to the position ``to``, 0...1 of the travel, and return at once.

        Raises
        ------
        BadInput : on a recording, and for a position outside the travel.
        """
        ...

    def wait(self, frames: int) -> None:
        """Let at least ``frames`` more frames pass; a camera that delivers packets may let pass a few more.

        More frames than are left end the run: compare ``now`` with ``frames``.

        Raises
        ------
        BadInput : on a recording.
        """
        ...


def commands(search: object) -> bool:
    """Return whether a search commands the lens (``commands = True``), so that it needs a running camera."""
    return bool(getattr(search, "commands", False))


def wants_measures(search: object) -> tuple[str, ...]:
    """Return the names of the focus measures that a search uses beside the method's own (``measures``)."""
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
    """Where a search finds the focus; with neither ``frame`` nor ``position`` it abstains.

    Parameters
    ----------
    frame : float, optional
        The frame at best focus, from 0. It may be fractional: the centre of frames a...b-1 is (a+b-1)/2.
    trace : tuple of float
        The steps of the search, in its own convention.
    note : str
        One line for the reader, such as why the search abstained.
    position : float, optional
        The lens position at best focus, 0...1 of the travel: the answer of a search that commands the lens.
    """

    frame: float | None = None
    trace: tuple[float, ...] = ()
    note: str = ""
    position: float | None = None


class Search(Protocol):
    """A search: it scores windows of frames through a view, and answers where the focus is.

    Class attributes, all optional: ``commands`` (bool), it moves the lens; ``measures`` (tuple of str), the
    focus measures that it uses beside the method's own.
    """

    def __call__(self, view: View) -> Answer:
        """Return the answer for a recording or a closed-loop run."""
        ...
