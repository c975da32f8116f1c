"""One way through the travel, the paper's motion."""

from dataclasses import dataclass

import numpy as np

from saf_gen.motions._option_checks import check_endpoints


@dataclass(frozen=True)
class Sweep:
    """From ``from`` to ``to`` at constant speed, in the whole recording.

    Either direction, and part of the travel: both are fractions of it. The recording begins and ends while
    the lens is moving.
    """

    from_: float = 0.0
    to: float = 1.0

    def __post_init__(self) -> None:
        check_endpoints(self.from_, self.to)

    def positions(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Fraction of the travel at each time."""
        return self.from_ + (self.to - self.from_) * (np.asarray(seconds, dtype=np.float64) / duration_s)
