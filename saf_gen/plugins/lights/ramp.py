"""Light that rises or falls linearly, the continuous variation of the spike autofocus paper."""

from dataclasses import dataclass
from math import inf

import numpy as np

from saf_gen.errors import BadInput


@dataclass(frozen=True)
class Ramp:
    """The gain changes linearly from ``from`` to ``to`` over ``over_s`` seconds, and is constant afterwards.

    If ``over_s`` is not given, the change takes the entire recording.
    """

    endless = True

    from_: float
    """Gain, 0 or more: the gain at the beginning of the recording."""
    to: float
    """Gain, 0 or more: the gain at the end of the change."""
    over_s: float | None = None
    """Seconds, above 0, or the entire recording: the duration of the change, after which the gain is constant."""

    def __post_init__(self) -> None:
        if not (0 <= self.from_ < inf and 0 <= self.to < inf):
            raise BadInput(f"from {self.from_!r} to {self.to!r}", allowed="gains of 0 or more")
        if self.over_s is not None and not 0 < self.over_s < inf:
            raise BadInput(f"over_s is {self.over_s!r}", allowed="seconds above 0")

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the integral of the gain from 0 to each time, in seconds."""
        length = duration_s if self.over_s is None else self.over_s
        seconds = np.asarray(seconds, dtype=np.float64)
        moving = np.minimum(seconds, length)
        slope = (self.to - self.from_) / length
        return self.from_ * moving + 0.5 * slope * moving**2 + self.to * (seconds - moving)

    def gain(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the gain at each time."""
        length = duration_s if self.over_s is None else self.over_s
        return np.interp(seconds, [0.0, length], [self.from_, self.to])

    def breaks(self, duration_s: float) -> np.ndarray:
        """Return the end of the change, at which the gain bends, in seconds."""
        return np.array([duration_s if self.over_s is None else self.over_s])
