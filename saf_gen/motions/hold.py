"""A lens that stays where it is."""

from dataclasses import dataclass

import numpy as np

from saf_gen.motions._option_checks import check_position


@dataclass(frozen=True)
class Hold:
    """The lens rests at ``position``, a fraction of the travel, throughout."""

    position: float

    def __post_init__(self) -> None:
        check_position("position", self.position)

    def positions(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Fraction of the travel at each time."""
        return np.full(np.shape(seconds), float(self.position))
