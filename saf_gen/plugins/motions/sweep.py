"""One pass through the travel, the motion of the spike autofocus paper."""

from dataclasses import dataclass

import numpy as np

from saf_gen.plugins.motions._option_checks import check_motion_endpoints


@dataclass(frozen=True)
class Sweep:
    """The lens moves from ``from`` to ``to``, fractions of the travel, at constant speed.

    The sweep fills the recording, which begins and ends while the lens moves.
    """

    from_: float = 0.0
    """Fraction of the travel, 0 to 1: where the lens begins."""
    to: float = 1.0
    """Fraction of the travel, 0 to 1: where it ends; backwards, or over a part of the travel, as you like."""

    def __post_init__(self) -> None:
        check_motion_endpoints(self.from_, self.to)

    def positions(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the position at each time, a fraction of the travel."""
        return self.from_ + (self.to - self.from_) * (np.asarray(seconds, dtype=np.float64) / duration_s)
