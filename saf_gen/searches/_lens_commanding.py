"""What searches that command the lens share: move, wait until it stands still, look; and stop in time."""

import math
from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.searches._golden_narrowing import check_frame_count

__all__ = ["FocusSampler", "LensCommandingSearch", "check_fraction"]

READING_S = 0.001
"""Seconds that one reading of the lens position is the mean of."""
READINGS_AT_TARGET, READINGS_OFF_TARGET = 4, 50
"""Readings that must agree for a lens at its place, and for one that came to rest beside it."""
START_S = 0.3
"""Longest time from a command to the first motion; a hand takes 0.2 s."""


class OutOfFramesError(Exception):
    """No frames are left for another look."""


@dataclass(frozen=True)
class FocusSample:
    """One look: where the lens was (fraction of the travel), and the score there."""

    position: float
    score: float


class FocusSampler:
    """Looks through a lens that this moves. Each costs the way, the settling and ``dt`` frames.

    Parameters
    ----------
    view : a running camera.
    dt : frames that a look scores.
    still : how much a lens that stands may move, fraction of the travel.
    lag_s : time in which motion that the position sensor does not see falls to 1/e; None: what the view says.
    timeout_s : seconds after which it is looked at wherever it is; without a position sensor, always.

    ``trace`` holds every place looked at, ``seen`` the looks since the last change of the measure.
    """

    def __init__(self, view: View, dt: int, *, still: float, lag_s: float | None, timeout_s: float) -> None:
        self._view, self._dt, self._still = view, dt, still
        self._lag_s = view.lag_s if lag_s is None else lag_s
        self._reading = max(round(READING_S * view.readout_hz), 2)
        self._timeout = max(round(timeout_s * view.readout_hz), 1)
        self._measure: str | None = None
        self._before: FocusSample | None = None
        self.seen: list[FocusSample] = []
        self.trace: list[float] = []

    def switch_measure(self, measure: str | None, dt: int) -> None:
        """Score windows of ``dt`` frames by ``measure`` (None: the method's own) from now on.

        FocusSampler so far are then in another unit: the best of them counts only until there is a new one.
        """
        self._before, self.seen = self.best(), []
        self._measure, self._dt = measure, dt

    def __call__(self, to: float) -> float:
        """The score with the lens at ``to``, cut to the travel. Raises OutOfFramesError without time for
        it."""
        view, to = self._view, min(max(to, 0.0), 1.0)
        origin = self._read(max(view.now - self._reading, 0), view.now)[0] if view.now else math.nan
        view.move(to)
        self._rest(to, origin)
        away = 1.0 if math.isnan(origin) else abs(to - origin)
        if away > self._still:
            self._pass(round(self._lag_s * math.log(away / self._still) * view.readout_hz))
        first = view.now
        if view.frames - first < self._dt:
            raise OutOfFramesError
        score = view.score(first, first + self._dt, self._measure)
        read = self._read(first, first + self._dt)[0]
        where = to if math.isnan(read) else min(max(read, 0.0), 1.0)
        self.seen.append(FocusSample(where, score))
        self.trace.append(where)
        return score

    def start(self) -> float:
        """Where the lens stands before the first move; the middle where no sensor says so."""
        if self._view.now == 0:
            self._pass(1)
        position = self._read(0, self._view.now)[0]
        return 0.5 if math.isnan(position) else min(max(position, 0.0), 1.0)

    def best(self) -> FocusSample | None:
        """The look with the highest score, the first of equal ones; None before any."""
        return max(self.seen, key=lambda look: look.score, default=self._before)

    def _rest(self, to: float, origin: float) -> None:
        """Wait until the lens, as the sensor reads it, stands at its place, or beside it and goes no further.

        It set off from ``origin``, NaN where that is not known. Readings count as equal within ``still`` and
        what the sensor's noise explains.
        """
        begin = self._view.now
        readings: deque[float] = deque(maxlen=READINGS_OFF_TARGET)
        while self._view.now - begin < self._timeout:
            first = self._view.now
            self._pass(min(self._reading, self._timeout))
            here, noise = self._read(first, self._view.now)
            readings.append(here)
            origin = here if math.isnan(origin) else origin
            same = self._still + 4 * noise
            if abs(here - to) <= 2 * self._still + 4 * noise:
                needed = READINGS_AT_TARGET
            elif abs(here - origin) > same or self._view.now - begin > START_S * self._view.readout_hz:
                needed = READINGS_OFF_TARGET
            else:
                continue  # it has not set off yet
            latest = list(readings)[-needed:]
            if len(latest) == needed and max(latest) - min(latest) <= same:
                return

    def _pass(self, frames: int) -> None:
        if self._view.frames - self._view.now < frames + self._dt:
            raise OutOfFramesError
        if frames > 0:
            self._view.wait(frames)

    def _read(self, first: int, stop: int) -> tuple[float, float]:
        """Mean position over these frames, and the rms noise of that mean, from neighbouring frames."""
        positions = [self._view.position(t) for t in range(first, stop)]
        jumps = [(b - a) ** 2 for a, b in pairwise(positions)]
        noise = math.sqrt(math.fsum(jumps) / (2 * len(jumps) * len(positions))) if jumps else 0.0
        return math.fsum(positions) / len(positions), noise


@dataclass(frozen=True)
class LensCommandingSearch:
    """A search that commands the lens: the keys all of them have, and how they end.

    ``dt`` frames are scored a look, once the lens stands: within ``still`` of the travel for some
    milliseconds as its sensor reads it, and after ringing that a sensor at the motor does not see, which
    falls to 1/e in ``lag_s`` (None: as the drive's maker says). ``timeout_s`` bounds the wait.

    A search that runs out of frames answers with the best place so far, one without a single look abstains.
    The place is what the sensor read during the look, so that what it sees of backlash and misses is in it.
    The trace holds the places looked at.
    """

    dt: int = 100
    still: float = 0.002
    lag_s: float | None = None
    timeout_s: float = 1.5

    commands: ClassVar[bool] = True
    causal: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_frame_count(self.dt, "dt")
        check_fraction("still", self.still)
        if self.lag_s is not None and not (_number(self.lag_s) and 0 <= self.lag_s <= 1):
            raise BadInput(f"lag_s is {self.lag_s!r}", allowed="seconds, 0 to 1")
        if not (_number(self.timeout_s) and 0 < self.timeout_s <= 60):
            raise BadInput(f"timeout_s is {self.timeout_s!r}", allowed="seconds, above 0, at most 60")

    def __call__(self, view: View) -> Answer:
        """Search with the lens of ``view``. Raises BadInput on a recording, whose lens cannot be moved."""
        look = FocusSampler(view, self.dt, still=self.still, lag_s=self.lag_s, timeout_s=self.timeout_s)
        try:
            note = self.seek_focus(look)
        except OutOfFramesError:
            note = "out of frames"
        best, trace = look.best(), tuple(look.trace)
        if best is None:
            return Answer(None, trace, f"{note} before the first look")
        return Answer(None, trace, note, position=best.position)

    def seek_focus(self, look: FocusSampler) -> str:
        """Look here and there until done, at least once; the answer is the best look, the text its note."""
        raise NotImplementedError


def _number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def check_fraction(key: str, value: float) -> None:
    """Raises BadInput unless ``value`` is a share of the travel, above 0 and below 1."""
    if not (_number(value) and 0 < value < 1):
        raise BadInput(f"{key} is {value!r}", allowed="a fraction of the travel, above 0 and below 1")
