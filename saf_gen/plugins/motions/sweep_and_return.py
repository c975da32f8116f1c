"""A sweep and its return: every position is passed twice, in both directions."""

from dataclasses import dataclass

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.plugins.motions._option_checks import check_motion_duration, check_motion_endpoints


@dataclass(frozen=True)
class SweepAndReturn:
    """The lens moves from ``from`` to ``to``, rests there for ``dwell_s`` seconds, and moves back.

    Both directions have the same constant speed and together fill the recording; the lens turns at once.
    """

    from_: float = 0.0
    """Fraction of the travel, 0 to 1: where the lens begins."""
    to: float = 1.0
    """Fraction of the travel, 0 to 1: where it turns, and goes back at the same speed."""
    dwell_s: float = 0.0
    """Seconds, 0 up to the recording: the rest at ``to``."""

    def __post_init__(self) -> None:
        check_motion_endpoints(self.from_, self.to)
        check_motion_duration("dwell_s", self.dwell_s)

    def positions(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the position at each time; raises BadInput where the rest leaves no time to move."""
        if not self.dwell_s < duration_s:
            raise BadInput(
                f"dwell_s is {self.dwell_s:g} in a recording of {duration_s:g} s",
                allowed=f"0 or more, below {duration_s:g}",
                hint="shorten it, or record more frames",
            )
        there = (duration_s - self.dwell_s) / 2
        moments = [0.0, there, there + self.dwell_s, duration_s]
        return np.interp(seconds, moments, [self.from_, self.to, self.to, self.from_])
