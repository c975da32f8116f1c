"""Protocols of the plug-ins: light schedules, lens motions, focus measures and searches.

A plug-in is a frozen dataclass with the members of its protocol; it need not inherit from the protocol. The only
modules of saf_gen that it imports are :mod:`saf_gen.core`, :mod:`saf_gen.errors` and this one, and saf_gen uses only
the members that are described here.
"""

import re
from dataclasses import dataclass
from inspect import cleandoc
from typing import Protocol, runtime_checkable

import numpy as np


class Light(Protocol):
    """A light schedule: the gain of a light group over the time of a recording.

    With the class attribute ``endless = True``, it goes on after the recording: its methods then take later times too,
    and a closed loop may last longer than the recording.

    Two fields have a meaning in recipes. ``seed``, a whole number, selects the random stream of the schedule; if the
    recipe gives no seed, each sequence gets a different one. ``file`` is a path in the recipe: the file is read and
    passed to the plug-in as ``{"path": ..., "text": ...}``.
    """

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the integral of the gain from time 0 to each given time, in seconds.

        A pixel integrates light over a readout, so a schedule is described by its antiderivative. The mean gain of
        a readout is then exact, even for steps and flicker.

        Parameters
        ----------
        seconds : ndarray of float64, any shape
            Times in seconds, 0...duration_s.
        duration_s : float
            Length of the recording in seconds, above 0.

        Returns
        -------
        ndarray of float64, shape of ``seconds``
            Gain times seconds.
        """
        ...


@runtime_checkable
class LightFactor(Light, Protocol):
    """A light schedule that may be a factor of a product, which multiplies gains at each moment."""

    def gain(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the gain at each time, 0 or more: the slope of the integral.

        Parameters
        ----------
        seconds : ndarray of float64, any shape
            Times in seconds, 0...duration_s, none of them a break.
        duration_s : float
            Length of the recording in seconds, above 0.

        Returns
        -------
        ndarray of float64, shape of ``seconds``
        """
        ...

    def breaks(self, duration_s: float) -> np.ndarray:
        """Return the times at which the gain jumps or bends, and between which it is smooth.

        Smooth means that a polynomial follows it to the last digits. Neighbours are therefore at most a quarter of the
        shortest period apart, or four time constants of a decay. Times outside the recording are allowed.

        Parameters
        ----------
        duration_s : float
            Length of the recording in seconds, above 0.

        Returns
        -------
        ndarray of float64, shape (N,)
            Times in seconds, in any order.
        """
        ...


class Motion(Protocol):
    """A motion of the lens over a recording; the fields ``seed`` and ``file`` mean the same as in :class:`Light`."""

    def positions(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the position of the lens at each time, as a fraction of the travel.

        Parameters
        ----------
        seconds : ndarray of float64, any shape
            Times in seconds, 0...duration_s.
        duration_s : float
            Length of the recording in seconds, above 0.

        Returns
        -------
        ndarray of float64, shape of ``seconds``
            Fractions of the travel, 0...1.

        Raises
        ------
        BadInput
            If the motion is not possible in a recording of this length.
        """
        ...


class Measure(Protocol):
    """A focus measure, which scores the spike counts of a window; a larger score means a sharper picture.

    Attributes
    ----------
    halves : bool, optional
        Whether the measure compares the two halves of a window. It is then called with counts of shape (2, row, col),
        of the first ``n // 2`` of n frames and of the remaining frames.
    intervals : bool, optional
        Whether the measure is called with interval texture instead of counts: float64, shape (row, col), the length of
        the window divided by the interval between the spikes around its middle.
    timed : bool, optional
        Whether the measure is called with the length of the window, in frames, as ``frames=n``. It must also work
        without this argument.
    cost : float, optional
        Number of additions, multiplications and roots per score and pixel of the region. Borders are ignored; if the
        cost depends on the size of the region, it is given for 400 x 250 pixels.
    score_range : str, optional
        Range of the score in words, such as "from 0"; the conformance checks require it.
    source : str, optional
        Source of the measure, such as a paper with its DOI; see :func:`cite_source`.
    """

    @property
    def degree(self) -> int:
        """Power of brightness in the score: multiplying the counts by ``a`` multiplies the score by ``a**degree``."""
        ...

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of the counts in a window; larger is sharper.

        Parameters
        ----------
        counts : ndarray of uint32, shape (row, col)
            Spikes per pixel in the region, which has at least one pixel.

        Returns
        -------
        float
            The score.
        """
        ...


def is_endless(light: object) -> bool:
    """Return whether a light schedule goes on after the recording (attribute ``endless``)."""
    return bool(getattr(light, "endless", False))


def wants_frames(measure: object) -> bool:
    """Return whether a focus measure is called with the length of the window as ``frames=n`` (attribute ``timed``)."""
    return bool(getattr(measure, "timed", False))


def wants_halves(measure: object) -> bool:
    """Return whether a focus measure is called with the counts of both halves of a window (attribute ``halves``)."""
    return bool(getattr(measure, "halves", False))


def wants_intervals(measure: object) -> bool:
    """Return whether a focus measure is called with interval texture, not counts (attribute ``intervals``)."""
    return bool(getattr(measure, "intervals", False))


class View(Protocol):
    """Everything that a search can see of a recording or of a running camera; the true focus is not included.

    Frames are readouts, counted from 0. All frames of a recording are available at once. In a closed-loop run, using a
    window that ends after ``now`` makes the camera run until the end of the window, while the lens keeps moving.
    """

    @property
    def frames(self) -> int:
        """Number of frames that may be used: the length of the recording, or the budget of a closed-loop run."""
        ...

    @property
    def now(self) -> int:
        """Number of frames that have passed; on a recording, the end of the latest window used."""
        ...

    @property
    def readout_hz(self) -> float:
        """Frames per second."""
        ...

    @property
    def lag_s(self) -> float:
        """Time, in seconds, in which a lens motion that the position sensor does not see decays to 1/e.

        The data sheet of a drive states it. It is 0 on a recording, and if the sensor reads the lens itself.
        """
        ...

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        """Return the score of the counts in frames ``first <= t < stop``.

        Parameters
        ----------
        first, stop : int
            Window of at least one frame, 0 <= first < stop <= ``frames``.
        measure : str, optional
            Name of the focus measure to use instead of the method's; the search must list it in ``measures``.

        Returns
        -------
        float
            The score; larger is sharper.
        """
        ...

    def counts(self, first: int, stop: int) -> np.ndarray:
        """Return the spike counts of frames ``first <= t < stop`` in the region.

        This is for searches that look at pictures, such as a network. It takes as much camera time as ``score``.

        Parameters
        ----------
        first, stop : int
            Window of at least one frame, 0 <= first < stop <= ``frames``.

        Returns
        -------
        ndarray of uint32, shape (row, col)
            Spikes per pixel in the window, read-only.
        """
        ...

    def polarities(self, first: int, stop: int) -> np.ndarray:
        """Return the events of frames ``first <= t < stop`` in the region, the falls of the light and then its rises.

        The first index is the polarity as event files store it: 0 for events of darker light, 1 for those of brighter
        light. Their sum over it is what ``counts`` returns. It takes as much camera time as ``counts``, and costs as
        much. Only an event camera has events; a search that cannot do without them says so (``polarities = True``).

        Parameters
        ----------
        first, stop : int
            Window of at least one frame, 0 <= first < stop <= ``frames``.

        Returns
        -------
        ndarray of uint32, shape (2, row, col)
            Events per pixel in the window: darker, brighter; read-only.

        Raises
        ------
        BadInput
            If the camera is no event camera.
        """
        ...

    def position(self, frame: int) -> float:
        """Return the lens position at a frame that has passed, as a fraction of the travel; NaN if unknown.

        In a closed-loop run this is the reading of the drive's position sensor, including its noise.

        Parameters
        ----------
        frame : int
            Frame, counted from 0.

        Returns
        -------
        float
            Fraction of the travel, or NaN.

        Raises
        ------
        BadInput
            If the frame is outside the recording or has not passed.
        """
        ...

    def move(self, to: float) -> None:
        """Command the lens to the position ``to``, and return at once.

        Parameters
        ----------
        to : float
            Fraction of the travel, 0...1.

        Raises
        ------
        BadInput
            If the view is of a recording or of a sweep, or if the position is outside the travel.
        """
        ...

    def wait(self, frames: int) -> None:
        """Let at least ``frames`` more frames pass; a camera that delivers packets may let a few more pass.

        Waiting for more frames than are left ends the run, so first compare :attr:`now` with :attr:`frames`.

        Parameters
        ----------
        frames : int
            Number of frames.

        Raises
        ------
        BadInput
            If the view is of a recording.
        """
        ...


def commands(search: object) -> bool:
    """Return whether a search commands the lens (``commands = True``) and therefore needs a running camera."""
    return bool(getattr(search, "commands", False))


def wants_polarities(search: object) -> bool:
    """Return whether a search needs events with their polarities (attribute ``polarities``)."""
    return bool(getattr(search, "polarities", False))


def wants_measures(search: object) -> tuple[str, ...]:
    """Return the names of the additional focus measures that a search uses (attribute ``measures``)."""
    return tuple(getattr(search, "measures", ()))


def cite_source(plug_in: object) -> str:
    """Return the source that a plug-in cites, on one line, or '' if it cites none.

    The source is the attribute ``source`` if that is a string, otherwise the numpydoc section References of the
    docstring.
    """
    source = getattr(plug_in, "source", None)
    if isinstance(source, str):
        return source.strip()
    _, _, after = cleandoc(plug_in.__doc__ or "").partition("\nReferences\n----------\n")
    references = re.split(r"\n\w+\n-+\n", after)[0]
    return " ".join(references.replace(".. [", "[").split())


@dataclass(frozen=True)
class Answer:
    """The answer of a search: the frame or the lens position at best focus, or neither if the search abstains.

    Parameters
    ----------
    frame : float, optional
        Frame at best focus, counted from 0. It may be fractional: the centre of frames a...b-1 is (a+b-1)/2.
    trace : tuple of float, optional
        Steps of the search; each search has its own convention.
    note : str, optional
        One line for the reader, such as why the search abstained.
    position : float, optional
        Lens position at best focus, as a fraction of the travel, 0...1; the answer of a search that commands the lens.
    """

    frame: float | None = None
    trace: tuple[float, ...] = ()
    note: str = ""
    position: float | None = None


class Search(Protocol):
    """A search, which scores windows of frames through a view and answers where the focus is.

    Attributes
    ----------
    commands : bool, optional
        Whether the search commands the lens.
    measures : tuple of str, optional
        Names of the focus measures that the search uses in addition to the method's.
    polarities : bool, optional
        Whether the search needs ``view.polarities``; it is then refused where there are no events.
    causal : bool, optional
        Whether the search can stop before the sweep ends; the conformance checks require this attribute.
    cost : float, optional
        Number of operations of the search itself for each window that it scores or looks at.
    look_cost : float, optional
        Number of operations per pixel of a window whose counts it looks at.
    source : str, optional
        Source of the search, such as a paper with its DOI; see :func:`cite_source`.
    """

    def __call__(self, view: View) -> Answer:
        """Return the answer for a recording or a closed-loop run.

        Parameters
        ----------
        view : View
            The recording, or the running camera.

        Returns
        -------
        Answer
            The frame or position at best focus, or neither.
        """
        ...
