"""Pulse-width modulation: light that is switched on and off rapidly, as in dimmed LEDs."""

from dataclasses import dataclass
from math import inf, isfinite

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.plugins.lights._breaks import repeated_breaks


@dataclass(frozen=True)
class Pwm:
    """The gain is ``high`` for the fraction ``duty`` of each period of 1/``hz`` seconds, then ``low``.

    The mean over whole periods is low + duty·(high - low). ``phase``, in radians, shifts the pattern to earlier times;
    at 0 the recording begins when the light is switched on.
    """

    endless = True

    hz: float
    """Hz, above 0: periods per second."""
    duty: float
    """Fraction of the period, 0 to 1: the time for which the light is on; the mean gain is low + duty·(high − low)."""
    low: float = 0.0
    """Gain, 0 to ``high``: the gain while the light is off."""
    high: float = 1.0
    """Gain, ``low`` or more: the gain while the light is on."""
    phase: float = 0.0
    """Radians: at 0 the recording begins when the light is switched on."""

    def __post_init__(self) -> None:
        if not 0 < self.hz < inf:
            raise BadInput(f"hz is {self.hz!r}", allowed="a frequency above 0 in Hz")
        if not 0 <= self.duty <= 1:
            raise BadInput(f"duty is {self.duty!r}", allowed="0 to 1 of the period")
        if not 0 <= self.low <= self.high < inf:
            raise BadInput(f"low is {self.low!r}, high {self.high!r}", allowed="gains with 0 <= low <= high")
        if not isfinite(self.phase):
            raise BadInput(f"phase is {self.phase!r}", allowed="radians")

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the integral of the gain from 0 to each time, in seconds."""
        seconds = np.asarray(seconds, dtype=np.float64)
        start = np.asarray(self.phase / (2 * np.pi))
        on = (self._periods_on(seconds * self.hz + start) - self._periods_on(start)) / self.hz
        return self.low * seconds + (self.high - self.low) * on

    def gain(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the gain at each time."""
        periods = np.asarray(seconds, dtype=np.float64) * self.hz + self.phase / (2 * np.pi)
        return np.where(periods - np.floor(periods) < self.duty, self.high, self.low)

    def breaks(self, duration_s: float) -> np.ndarray:
        """Return the times at which the light is switched on or off, in seconds."""
        start = self.phase / (2 * np.pi) % 1
        on = repeated_breaks(1 / self.hz, duration_s, first_s=-start / self.hz)
        return np.concatenate([on, on + self.duty / self.hz])

    def _periods_on(self, periods: np.ndarray) -> np.ndarray:
        """Return the time for which the light is on during the first ``periods`` periods, in periods."""
        complete = np.floor(periods)
        return complete * self.duty + np.minimum(periods - complete, self.duty)
