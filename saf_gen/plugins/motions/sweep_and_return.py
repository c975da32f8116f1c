"""A sweep there and back, in which the lens passes every position twice, once in each direction."""

from dataclasses import dataclass

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.plugins.motions._option_checks import check_duration, check_endpoints


@dataclass(frozen=True)
class SweepAndReturn:
    """The lens moves from ``from`` to ``to``, rests there for ``dwell_s`` seconds, and moves back.

    The speed is constant and the same in both directions, and the motion takes the entire recording. The lens reverses
    instantly.
    """

    from_: float = 0.0
    """Fraction of the travel, 0 to 1: the position at the beginning and at the end."""
    to: float = 1.0
    """Fraction of the travel, 0 to 1: the position at which the lens turns; it moves back at the same speed."""
    dwell_s: float = 0.0
    """Seconds, 0 or more, less than the recording: the time for which the lens rests at ``to``."""

    def __post_init__(self) -> None:
        check_endpoints(self.from_, self.to)
        check_duration("dwell_s", self.dwell_s)

    def positions(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the position at each time, a fraction of the travel.

        Raises BadInput if ``dwell_s`` leaves no time to move.
        """
        if not self.dwell_s < duration_s:
            raise BadInput(
                f"dwell_s is {self.dwell_s:g} in a recording of {duration_s:g} s",
                allowed=f"0 or more, below {duration_s:g}",
                hint="shorten dwell_s, or record more frames",
            )
        arrival = (duration_s - self.dwell_s) / 2
        moments = [0.0, arrival, arrival + self.dwell_s, duration_s]
        return np.interp(seconds, moments, [self.from_, self.to, self.to, self.from_])
