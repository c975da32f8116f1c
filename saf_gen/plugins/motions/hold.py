"""A lens at rest."""

from dataclasses import dataclass

import numpy as np

from saf_gen.plugins.motions._option_checks import check_position


@dataclass(frozen=True)
class Hold:
    """The lens rests at ``position``, a fraction of the travel."""

    position: float
    """Fraction of the travel, 0 to 1: the lens stays here."""

    def __post_init__(self) -> None:
        check_position("position", self.position)

    def positions(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the position at each time, a fraction of the travel."""
        return np.full(np.shape(seconds), float(self.position))
