"""Constant light."""

from dataclasses import dataclass
from math import inf

import numpy as np

from saf_gen.errors import BadInput


@dataclass(frozen=True)
class Constant:
    """The gain is ``level`` throughout the recording; at 0, the lamp is off."""

    endless = True

    level: float = 1.0
    """Gain, 0 or more: the gain throughout the recording; at 0, the lamp is off."""

    def __post_init__(self) -> None:
        if not 0 <= self.level < inf:
            raise BadInput(f"level is {self.level!r}", allowed="a gain of 0 or more")

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the integral of the gain from 0 to each time, in seconds."""
        return self.level * np.asarray(seconds, dtype=np.float64)

    def gain(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the gain at each time."""
        return np.full(np.shape(seconds), self.level, dtype=np.float64)

    def breaks(self, duration_s: float) -> np.ndarray:
        """Return the times at which the gain jumps or bends: none, in seconds."""
        return np.empty(0)
