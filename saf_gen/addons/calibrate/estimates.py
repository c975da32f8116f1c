"""Measured numbers with their confidence intervals and sources."""

from dataclasses import dataclass
from math import inf, sqrt

from scipy import stats

NORMAL_95 = 1.959963984540054
"""Half-width of a 95 % interval of a normal distribution, in standard errors."""


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval, ``low`` to ``high``, and a description of how it was found.

    Attributes
    ----------
    value : float
        The estimate.
    low, high : float
        Ends of the 95 % interval.
    how : str
        Description of the measurement.
    measured : bool
        False if only the interval is known; the value is then a choice within it.
    """

    value: float
    low: float
    high: float
    how: str
    measured: bool = True

    def holds(self, truth: float) -> bool:
        """Return whether a number is in the interval, ends included."""
        return self.low <= truth <= self.high


def normal_estimate(value: float, error: float, *, how: str, minimum: float = -inf, maximum: float = inf) -> Estimate:
    """Return an estimate from a value and its standard error, clipped to the range ``minimum`` to ``maximum``."""
    low, high = value - NORMAL_95 * error, value + NORMAL_95 * error
    cut = [min(max(x, minimum), maximum) for x in (value, low, high)]
    return Estimate(cut[0], cut[1], cut[2], how)


def root_estimate(square: float, error: float, *, how: str) -> Estimate:
    """Return an estimate of the square root of a number with a standard error; the root of a negative number is 0."""
    low, high = (sqrt(max(square + sign * NORMAL_95 * error, 0.0)) for sign in (-1, 1))
    return Estimate(sqrt(max(square, 0.0)), low, high, how)


def binomial_interval(hits: int, trials: int) -> tuple[float, float]:
    """Return the 95 % interval of a probability (Clopper and Pearson 1934, doi:10.1093/biomet/26.4.404)."""
    low = stats.beta.ppf(0.025, hits, trials - hits + 1) if hits else 0.0
    return float(low), float(stats.beta.ppf(0.975, hits + 1, trials - hits))
