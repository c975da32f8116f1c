"""Common code of searches that command the lens: move, wait until the lens rests, score, and stop in time."""

import math
from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._windows import check_frame_count

READING_S = 0.001
"""Seconds over which one reading of the lens position is averaged."""
READINGS_AT_TARGET, READINGS_OFF_TARGET = 4, 50
"""Numbers of readings that must agree if the lens is at its target, and if it has come to rest elsewhere."""
START_S = 0.3
"""Longest time from a command to the first motion, in seconds; a hand takes 0.2 s."""


class OutOfFramesError(Exception):
    """Too few frames are left for another sample."""


@dataclass(frozen=True)
class FocusSample:
    """A lens position, as a fraction of the travel, and the score of a window there."""

    position: float
    score: float


class FocusSampler:
    """Moves the lens and scores a window of ``dt`` frames where the lens comes to rest.

    Parameters
    ----------
    view : View
        A running camera.
    dt : int
        Frames per score.
    still : float
        Largest motion of a lens that counts as at rest, as a fraction of the travel.
    lag_s : float or None
        Seconds in which a motion that the position sensor does not see decays to 1/e; if None, ``view.lag_s``.
    timeout_s : float
        Seconds after which the window is scored even if the lens is not at rest. Without a position sensor, the wait
        always takes this time.

    Attributes
    ----------
    trace : list of float
        Positions of all samples.
    samples : list of FocusSample
        Samples since the last change of the measure.
    """

    def __init__(self, view: View, dt: int, *, still: float, lag_s: float | None, timeout_s: float) -> None:
        self._view, self._dt, self._still = view, dt, still
        self._lag_s = view.lag_s if lag_s is None else lag_s
        self._reading = max(round(READING_S * view.readout_hz), 2)
        self._timeout = max(round(timeout_s * view.readout_hz), 1)
        self._measure: str | None = None
        self._best_before: FocusSample | None = None
        self.samples: list[FocusSample] = []
        self.trace: list[float] = []

    def switch_measure(self, measure: str | None, dt: int) -> None:
        """Score windows of ``dt`` frames with ``measure``, or with the method's measure if it is None, from now on.

        Scores of different measures cannot be compared, so the best sample so far counts only until there is a new one.
        """
        self._best_before, self.samples = self.best(), []
        self._measure, self._dt = measure, dt

    def __call__(self, to: float) -> float:
        """Move the lens to ``to``, clipped to the travel, and return the score where it comes to rest.

        Raises OutOfFramesError if too few frames are left.
        """
        view, to = self._view, min(max(to, 0.0), 1.0)
        origin = self._read(max(view.now - self._reading, 0), view.now)[0] if view.now else math.nan
        view.move(to)
        self._wait_for_rest(to, origin)
        distance = 1.0 if math.isnan(origin) else abs(to - origin)
        if distance > self._still:
            self._wait(round(self._lag_s * math.log(distance / self._still) * view.readout_hz))
        first = view.now
        if view.frames - first < self._dt:
            raise OutOfFramesError
        score = view.score(first, first + self._dt, self._measure)
        read = self._read(first, first + self._dt)[0]
        position = to if math.isnan(read) else min(max(read, 0.0), 1.0)
        self.samples.append(FocusSample(position, score))
        self.trace.append(position)
        return score

    def read_start(self) -> float:
        """Return the lens position before the first move, or 0.5 if no sensor reads it."""
        if self._view.now == 0:
            self._wait(1)
        position = self._read(0, self._view.now)[0]
        return 0.5 if math.isnan(position) else min(max(position, 0.0), 1.0)

    def best(self) -> FocusSample | None:
        """Return the sample with the highest score, the first of equal ones; None if there is no sample yet.

        The best sample from before a change of the measure is returned only if there is no sample since.
        """
        return max(self.samples, key=lambda sample: sample.score, default=self._best_before)

    def _wait_for_rest(self, to: float, origin: float) -> None:
        """Wait until the position sensor reads the lens at rest, at ``to`` or elsewhere, or until the timeout.

        ``origin`` is the position before the move, NaN if it is unknown. Readings count as equal if they differ by no
        more than ``still`` and the noise of the sensor.
        """
        begin = self._view.now
        readings: deque[float] = deque(maxlen=READINGS_OFF_TARGET)
        while self._view.now - begin < self._timeout:
            first = self._view.now
            self._wait(min(self._reading, self._timeout))
            here, noise = self._read(first, self._view.now)
            readings.append(here)
            origin = here if math.isnan(origin) else origin
            tolerance = self._still + 4 * noise
            if abs(here - to) <= 2 * self._still + 4 * noise:
                needed = READINGS_AT_TARGET
            elif abs(here - origin) > tolerance or self._view.now - begin > START_S * self._view.readout_hz:
                needed = READINGS_OFF_TARGET
            else:
                continue  # the lens has not started to move
            latest = list(readings)[-needed:]
            if len(latest) == needed and max(latest) - min(latest) <= tolerance:
                return

    def _wait(self, frames: int) -> None:
        if self._view.frames - self._view.now < frames + self._dt:
            raise OutOfFramesError
        if frames > 0:
            self._view.wait(frames)

    def _read(self, first: int, stop: int) -> tuple[float, float]:
        """Return the mean position over frames, and the rms noise of that mean, estimated from neighbouring frames."""
        positions = [self._view.position(t) for t in range(first, stop)]
        jumps = [(b - a) ** 2 for a, b in pairwise(positions)]
        noise = math.sqrt(math.fsum(jumps) / (2 * len(jumps) * len(positions))) if jumps else 0.0
        return math.fsum(positions) / len(positions), noise


@dataclass(frozen=True)
class LensCommandingSearch:
    """Base class of searches that command the lens, with the options that all of them have.

    A search that runs out of frames answers with the best position so far, and abstains if it has no sample. The answer
    is the position that the sensor read during the sample, including backlash and missed steps as far as the sensor
    sees them. The trace holds the positions of all samples.

    Parameters
    ----------
    dt : int, default 100
        Frames that are scored per sample, once the lens rests.
    still : float, default 0.002
        Largest motion of a lens that counts as at rest, as its sensor reads it over some milliseconds; a fraction of
        the travel.
    lag_s : float, optional
        Seconds, 0 to 1, in which ringing that a sensor at the motor does not see decays to 1/e. The search waits until
        it has decayed. By default, the value that the maker of the drive states.
    timeout_s : float, default 1.5
        Longest time to wait for the lens, in seconds, above 0 and at most 60.
    """

    dt: int = 100
    still: float = 0.002
    lag_s: float | None = None
    timeout_s: float = 1.5

    commands: ClassVar[bool] = True
    causal: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_frame_count("dt", self.dt)
        check_fraction("still", self.still)
        if self.lag_s is not None and not (_is_number(self.lag_s) and 0 <= self.lag_s <= 1):
            raise BadInput(f"lag_s is {self.lag_s!r}", allowed="seconds, 0 to 1")
        if not (_is_number(self.timeout_s) and 0 < self.timeout_s <= 60):
            raise BadInput(f"timeout_s is {self.timeout_s!r}", allowed="seconds, above 0, at most 60")

    def __call__(self, view: View) -> Answer:
        """Return the answer of a search with the lens of ``view``.

        Raises BadInput on a recording, whose lens cannot be moved.
        """
        sample = FocusSampler(view, self.dt, still=self.still, lag_s=self.lag_s, timeout_s=self.timeout_s)
        try:
            note = self.seek_focus(sample)
        except OutOfFramesError:
            note = "out of frames"
        best, trace = sample.best(), tuple(sample.trace)
        if best is None:
            return Answer(None, trace, f"{note} before the first look")
        return Answer(None, trace, note, position=best.position)

    def seek_focus(self, sample: FocusSampler) -> str:
        """Call ``sample`` at one or more lens positions, and return a note; the best sample becomes the answer."""
        raise NotImplementedError


@dataclass(frozen=True)
class BracketingSearch(LensCommandingSearch):
    """A search that narrows a bracket around the focus to ``tolerance``, a fraction of the travel."""

    tolerance: float = 0.01

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fraction("tolerance", self.tolerance)


def check_fraction(key: str, value: float) -> None:
    """Raise BadInput unless ``value`` is a fraction of the travel, above 0 and below 1."""
    if not (_is_number(value) and 0 < value < 1):
        raise BadInput(f"{key} is {value!r}", allowed="a fraction of the travel, above 0 and below 1")


def check_steps(coarse: float, fine: float) -> None:
    """Raise BadInput unless both steps are fractions of the travel and ``fine`` is at most ``coarse``."""
    check_fraction("coarse", coarse)
    check_fraction("fine", fine)
    if fine > coarse:
        raise BadInput(f"fine is {fine!r}", allowed=f"no more than coarse, {coarse!r}")


def divide_interval(low: float, high: float, *, step: float) -> list[float]:
    """Return evenly spaced positions from ``low`` to ``high``, both included, at most ``step`` apart."""
    parts = max(math.ceil(round((high - low) / step, 6)), 1)  # ends may differ by rounding alone
    return [low + (high - low) * k / parts for k in range(parts + 1)]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
