"""A lamp on the mains, which flickers at twice the mains frequency and its harmonics."""

from dataclasses import dataclass
from math import inf, isfinite

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.plugins.lights._breaks import repeated_breaks


@dataclass(frozen=True)
class Flicker:
    """The gain is ``level`` · (1 + s · Σ ``harmonics``[n] · cos((n + 1)(2π · ``hz`` · t + ``phase``))).

    The scale s follows from ``depth``, the modulation depth (highest - lowest)/(highest + lowest) of IEEE
    Std 1789-2015. The mean over whole periods is exactly ``level``.

    ``hz`` is 100 for mains of 50 Hz and 120 for 60 Hz. ``harmonics`` are the relative amplitudes of hz, 2·hz,
    3·hz, ...; those of a rectified sine begin with [1, -0.2, 0.0857]. ``phase`` is in radians; at 0 the recording
    begins at a crest of the fundamental.
    """

    endless = True

    depth: float
    """0 to 1: modulation depth, (highest − lowest)/(highest + lowest)."""
    hz: float = 100.0
    """Hz, above 0: twice the mains frequency, 100 or 120."""
    harmonics: tuple[float, ...] = (1.0,)
    """List, not all 0: the relative amplitudes of hz, 2·hz, 3·hz, …"""
    level: float = 1.0
    """Gain, 0 or more: the exact mean over a period."""
    phase: float = 0.0
    """Radians: at 0 the recording begins at a crest."""

    def __post_init__(self) -> None:
        if not 0 <= self.depth <= 1:
            raise BadInput(f"depth is {self.depth!r}", allowed="0 to 1: light is not negative")
        if not 0 < self.hz < inf:
            raise BadInput(f"hz is {self.hz!r}", allowed="a frequency above 0 in Hz")
        if not (any(self.harmonics) and all(isfinite(a) for a in self.harmonics)):
            raise BadInput(f"harmonics are {self.harmonics!r}", allowed="a list of amplitudes, not all 0")
        if not 0 <= self.level < inf:
            raise BadInput(f"level is {self.level!r}", allowed="a gain of 0 or more")
        if not isfinite(self.phase):
            raise BadInput(f"phase is {self.phase!r}", allowed="radians")

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the integral of the gain from 0 to each time, in seconds."""
        seconds = np.asarray(seconds, dtype=np.float64)
        omega = 2 * np.pi * self.hz
        wave = np.zeros_like(seconds)
        for n, amplitude in enumerate(self.harmonics, start=1):
            turned = np.sin(n * (omega * seconds + self.phase)) - np.sin(n * self.phase)
            wave += amplitude * turned / (n * omega)
        return self.level * (seconds + self._scale() * wave)

    def gain(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the gain at each time."""
        turned = 2 * np.pi * self.hz * np.asarray(seconds, dtype=np.float64) + self.phase
        wave = np.zeros_like(turned)
        for n, amplitude in enumerate(self.harmonics, start=1):
            wave += amplitude * np.cos(n * turned)
        return self.level * (1 + self._scale() * wave)

    def breaks(self, duration_s: float) -> np.ndarray:
        """Return times a quarter of the shortest period apart, in seconds."""
        highest = max(n for n, amplitude in enumerate(self.harmonics, start=1) if amplitude)
        return repeated_breaks(0.25 / (highest * self.hz), duration_s)

    def _scale(self) -> float:
        """Return the factor s for which gains from 1 + s·low to 1 + s·high have the modulation depth ``depth``."""
        low, high = _extremes(np.asarray(self.harmonics, dtype=np.float64))
        return 2 * self.depth / ((high - low) - self.depth * (high + low))


def _extremes(amplitudes: np.ndarray) -> tuple[float, float]:
    """Return the lowest and highest value of Σ a_n cos(nθ).

    The extremes are among the roots of the derivative, a polynomial in exp(iθ). A root off the unit circle only adds an
    angle at which the sum is not extreme.
    """
    orders = np.arange(1, len(amplitudes) + 1)
    slopes = orders * amplitudes
    angles = np.angle(np.roots(np.concatenate((slopes[::-1], [0.0], -slopes))))
    wave = np.cos(np.outer(np.append(angles, 0.0), orders)) @ amplitudes
    return float(wave.min()), float(wave.max())
