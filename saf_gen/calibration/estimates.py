"""A number that was measured: its value, its interval, and what stands behind it."""

from dataclasses import dataclass
from math import inf, sqrt

NORMAL_95 = 1.959963984540054
"""Standard errors on either side of a value that a 95 % interval reaches."""


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval, ``low`` to ``high``, and how it was found, in words.

    ``measured`` is false where the interval is all that is known: the value is then a choice within it.
    """

    value: float
    low: float
    high: float
    how: str
    measured: bool = True

    def holds(self, truth: float) -> bool:
        """Return whether the interval holds a number."""
        return self.low <= truth <= self.high


def normal_estimate_of_fit(value: float, error: float, *, how: str, least: float = -inf, most: float = inf) -> Estimate:
    """Return an estimate from its standard error, cut to what is possible, ``least`` to ``most``."""
    low, high = value - NORMAL_95 * error, value + NORMAL_95 * error
    cut = [min(max(x, least), most) for x in (value, low, high)]
    return Estimate(cut[0], cut[1], cut[2], how)


def root_estimate_of_fit(square: float, error: float, *, how: str) -> Estimate:
    """Return an estimate of the root of a number that is known with a standard error; below 0 the root is 0."""
    low, high = (sqrt(max(square + sign * NORMAL_95 * error, 0.0)) for sign in (-1, 1))
    return Estimate(sqrt(max(square, 0.0)), low, high, how)
