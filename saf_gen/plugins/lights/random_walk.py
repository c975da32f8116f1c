"""Light that varies at random, as when clouds pass the sun or people pass a lamp."""

from dataclasses import dataclass
from math import inf

import numpy as np

from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput
from saf_gen.plugins.lights._piecewise_linear import integrate_gain

STEP_S = 5e-4  # seconds between two points of the walk; the gain is interpolated linearly between them


@dataclass(frozen=True)
class RandomWalk:
    """The gain is ``level`` · exp(y - var(y)/2), where y is a Gaussian random walk; its mean is ``level``.

    If ``return_s`` is given, y is an Ornstein-Uhlenbeck process, stationary with standard deviation ``sd`` and
    correlation exp(-lag/return_s). Otherwise y is a Brownian motion, which begins at 0 and has the standard deviation
    sd·√t after t seconds.

    ``seed`` selects the walk, which does not depend on the length of the recording. If a recipe gives no seed, each
    sequence and light group gets a different one.

    References
    ----------
    G. E. Uhlenbeck and L. S. Ornstein, On the theory of the Brownian motion, Physical Review 36, 1930,
    doi:10.1103/PhysRev.36.823.
    """

    endless = True

    sd: float
    """Logarithm of gain, 0 to 3: the standard deviation after one second, or at all times if ``return_s`` is given."""
    return_s: float | None = None
    """Seconds, 0.005 or more, or never: the time constant with which the walk returns to its mean; its correlation is
    exp(−lag/return_s)."""
    level: float = 1.0
    """Gain, 0 or more: the expected gain at any time."""
    seed: int = 0
    """Whole number, 0 or more: the same seed gives the same walk; if a recipe gives no seed, each sequence and light
    group gets a different one."""

    def __post_init__(self) -> None:
        if not 0 <= self.sd <= 3:
            raise BadInput(f"sd is {self.sd!r}", allowed="0 to 3, of the logarithm of the gain")
        if self.return_s is not None and not 10 * STEP_S <= self.return_s < inf:
            raise BadInput(f"return_s is {self.return_s!r}", allowed=f"{10 * STEP_S:g} seconds and more")
        if not 0 <= self.level < inf:
            raise BadInput(f"level is {self.level!r}", allowed="a gain of 0 or more")
        if isinstance(self.seed, bool) or not isinstance(self.seed, int) or self.seed < 0:
            raise BadInput(f"seed is {self.seed!r}", allowed="a whole number, 0 or more")

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the integral of the gain from 0 to each time, in seconds."""
        times, gains = self._points(np.max(seconds, initial=duration_s))
        return integrate_gain(seconds, times=times, gains=gains)

    def gain(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the gain at each time."""
        times, gains = self._points(np.max(seconds, initial=duration_s))
        return np.interp(seconds, times, gains)

    def breaks(self, duration_s: float) -> np.ndarray:
        """Return the times of the points of the walk, in seconds."""
        return self._points(duration_s)[0]

    def _points(self, duration_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the times and gains (N,) of the points between which the gain is linear."""
        times = np.arange(int(np.ceil(duration_s / STEP_S)) + 2) * STEP_S
        draws = make_generator("random_walk", self.seed).standard_normal(len(times))
        if self.return_s is None:
            walk = self.sd * np.sqrt(STEP_S) * np.concatenate(([0.0], np.cumsum(draws[1:])))
            variance = self.sd**2 * times
        else:
            walk = self.sd * _stationary_walk(draws, float(np.exp(-STEP_S / self.return_s)))
            variance = np.full_like(times, self.sd**2)
        return times, self.level * np.exp(walk - variance / 2)


def _stationary_walk(draws: np.ndarray, kept: float) -> np.ndarray:
    """Return a stationary walk of variance 1 that keeps the fraction ``kept`` of its value from point to point."""
    innovation = (1 - kept * kept) ** 0.5
    walk = draws.tolist()
    for i in range(1, len(walk)):
        walk[i] = kept * walk[i - 1] + innovation * walk[i]
    return np.array(walk)
