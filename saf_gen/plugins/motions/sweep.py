"""One pass through the travel at constant speed, as in the spike autofocus paper."""

from dataclasses import dataclass

import numpy as np

from saf_gen.plugins.motions._option_checks import check_endpoints


@dataclass(frozen=True)
class Sweep:
    """The lens moves from ``from`` to ``to``, fractions of the travel, at constant speed.

    The sweep takes the entire recording: the lens is already moving at the beginning and still moving at the end.
    """

    from_: float = 0.0
    """Fraction of the travel, 0 to 1: the position at the beginning."""
    to: float = 1.0
    """Fraction of the travel, 0 to 1: the position at the end; the sweep may go backwards, or cover a part of the
    travel."""

    def __post_init__(self) -> None:
        check_endpoints(self.from_, self.to)

    def positions(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the position at each time, a fraction of the travel."""
        return self.from_ + (self.to - self.from_) * (np.asarray(seconds, dtype=np.float64) / duration_s)
