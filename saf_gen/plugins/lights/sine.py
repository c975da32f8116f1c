"""Light that varies slowly, as from a dimmer moved by hand."""

from dataclasses import dataclass
from math import inf, isfinite

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.plugins.lights._breaks import repeated_breaks


@dataclass(frozen=True)
class Sine:
    """The gain is ``level`` · (1 + ``swing`` · sin(2π · ``hz`` · t + ``phase``)), phase in radians."""

    endless = True

    hz: float
    """Hz, above 0: the frequency of the gain, level·(1 + swing·sin(2π·hz·t + phase))."""
    swing: float = 0.5
    """Fraction of the level, 0 to 1: the amplitude."""
    level: float = 1.0
    """Gain, 0 or more: the mean gain."""
    phase: float = 0.0
    """Radians: at 0 the recording begins at the mean gain, rising."""

    def __post_init__(self) -> None:
        if not 0 < self.hz < inf:
            raise BadInput(f"hz is {self.hz!r}", allowed="a frequency above 0 in Hz")
        if not 0 <= self.swing <= 1:
            raise BadInput(f"swing is {self.swing!r}", allowed="0 to 1: light is not negative")
        if not 0 <= self.level < inf:
            raise BadInput(f"level is {self.level!r}", allowed="a gain of 0 or more")
        if not (isinstance(self.phase, int | float) and isfinite(self.phase)):
            raise BadInput(f"phase is {self.phase!r}", allowed="a number of radians, such as 1.57 or 1.0e-3")

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the integral of the gain from 0 to each time, in seconds."""
        seconds = np.asarray(seconds, dtype=np.float64)
        omega = 2 * np.pi * self.hz
        swung = (np.cos(self.phase) - np.cos(omega * seconds + self.phase)) / omega
        return self.level * (seconds + self.swing * swung)

    def gain(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the gain at each time."""
        wave = np.sin(2 * np.pi * self.hz * np.asarray(seconds, dtype=np.float64) + self.phase)
        return self.level * (1 + self.swing * wave)

    def breaks(self, duration_s: float) -> np.ndarray:
        """Return times a quarter of a period apart, in seconds."""
        return repeated_breaks(0.25 / self.hz, duration_s)
