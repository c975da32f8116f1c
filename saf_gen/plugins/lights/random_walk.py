"""Light that varies at random, as clouds before the sun or people who pass a lamp make it."""

from dataclasses import dataclass
from math import inf

import numpy as np

from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput
from saf_gen.plugins.lights._piecewise_linear import integrate_piecewise_linear_gain

STEP_S = 5e-4  # seconds between two points of the walk, which straight lines connect


@dataclass(frozen=True)
class RandomWalk:
    """The gain is ``level`` · exp(y - var(y)/2), where y is a Gaussian random walk; its mean is ``level``.

    With ``return_s`` y is an Ornstein-Uhlenbeck process, stationary with standard deviation ``sd`` and
    correlation exp(-lag/return_s). Without it y is a Brownian motion, which begins at 0 and has the standard
    deviation sd·√t after t seconds.

    ``seed`` names the walk, which does not depend on the length of the recording. Where a recipe gives none,
    each sequence has its own.

    References
    ----------
    G. E. Uhlenbeck and L. S. Ornstein, On the theory of the Brownian motion, Physical Review 36, 1930,
    doi:10.1103/PhysRev.36.823.
    """

    sd: float
    """Of ln gain, 0 to 3: standard deviation after one second, or throughout with ``return_s``."""
    return_s: float | None = None
    """Seconds, 0.005 or more, or never: it forgets, with correlation exp(−lag/return_s)."""
    level: float = 1.0
    """Gain, 0 or more: the expected gain, at all times."""
    seed: int = 0
    """Whole number, 0 or more: the same seed gives the same walk; in a recipe each sequence and light group has its
    own."""

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
        times = np.arange(int(np.ceil(duration_s / STEP_S)) + 2) * STEP_S
        draws = make_generator("random_walk", self.seed).standard_normal(len(times))
        if self.return_s is None:
            walk = self.sd * np.sqrt(STEP_S) * np.concatenate(([0.0], np.cumsum(draws[1:])))
            variance = self.sd**2 * times
        else:
            walk = self.sd * _stationary_walk(draws, float(np.exp(-STEP_S / self.return_s)))
            variance = np.full_like(times, self.sd**2)
        return integrate_piecewise_linear_gain(seconds, times=times, gains=self.level * np.exp(walk - variance / 2))


def _stationary_walk(draws: np.ndarray, kept: float) -> np.ndarray:
    """Return a stationary walk of variance 1 that keeps this fraction of its value from point to point."""
    fresh = (1 - kept * kept) ** 0.5
    walk = draws.tolist()
    for i in range(1, len(walk)):
        walk[i] = kept * walk[i - 1] + fresh * walk[i]
    return np.array(walk)
