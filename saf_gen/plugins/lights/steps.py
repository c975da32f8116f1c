"""Light that jumps between levels, the sudden change of the spike autofocus paper."""

from dataclasses import dataclass
from math import inf

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.plugins.lights._breaks import repeated_breaks

SHORTEST_S = 1e-6  # a readout at 1 MHz; cameras would record only the mean of shorter steps


@dataclass(frozen=True)
class Steps:
    """The gain changes every ``every_s`` seconds to the next of ``levels``, which repeat.

    ``every_s`` is at least 1 µs, so that all steps of a recording fit into memory.
    """

    endless = True

    every_s: float
    """Seconds, 1e-6 or more: the time between two changes."""
    levels: tuple[float, ...]
    """List of gains, each 0 or more: the gains in order; they repeat."""

    def __post_init__(self) -> None:
        if not SHORTEST_S <= self.every_s < inf:
            raise BadInput(f"every_s is {self.every_s!r}", allowed=f"{SHORTEST_S:g} s or more")
        if len(self.levels) < 1 or not all(0 <= level < inf for level in self.levels):
            raise BadInput(f"levels are {self.levels!r}", allowed="a list of gains of 0 or more")

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the integral of the gain from 0 to each time, in seconds."""
        seconds = np.asarray(seconds, dtype=np.float64)
        count = int(np.ceil(seconds.max(initial=duration_s) / self.every_s)) + 1
        levels = np.resize(np.asarray(self.levels, dtype=np.float64), count)
        knots = np.arange(count + 1) * self.every_s
        return np.interp(seconds, knots, np.concatenate(([0.0], np.cumsum(levels) * self.every_s)))

    def gain(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the gain at each time."""
        taken = np.floor(np.asarray(seconds, dtype=np.float64) / self.every_s).astype(np.int64) % len(self.levels)
        return np.asarray(self.levels, dtype=np.float64)[taken]

    def breaks(self, duration_s: float) -> np.ndarray:
        """Return the times of the changes, in seconds."""
        return repeated_breaks(self.every_s, duration_s)
