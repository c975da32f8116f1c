"""A drive that moves the lens from position to position in steps, and rings after each step."""

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.plugins.motions._option_checks import check_bounds, check_endpoints

MAX_STEPS = 100_000


@dataclass(frozen=True)
class Steps:
    """The lens moves from ``from`` to ``to`` in ``count`` equal steps, ``dwell_s`` seconds apart.

    The first step comes after ``dwell_s`` seconds; after the last step the lens rests at ``to``. If ``dwell_s`` is not
    given, the recording is divided evenly between the positions.

    The drive behaves like a mass on a spring, as a voice coil does. Its position x follows the command c by
    x″ + 2ζω·x′ + ω²·x = ω²·c, with ω = 2π·``natural_hz`` and ζ = ``damping`` [1]_. Below ζ = 1 it overshoots a step by
    exp(-πζ/√(1 - ζ²)) of the step and rings at natural_hz·√(1 - ζ²); it settles to within 2 % after about 4/(ζω)
    seconds. Ringing continues through the next step. The solution is exact.

    The travel ends at mechanical stops: an overshoot beyond 0 or 1 is cut off there, without a rebound.

    References
    ----------
    .. [1] K. Ogata, Modern Control Engineering, 5th edition, 2010, section 5-3.
    """

    count: int
    """Whole number, 1 to 100,000: the number of equal steps."""
    natural_hz: float
    """Hz, above 0, up to 100,000: the natural frequency of the drive, which behaves like a mass on a spring."""
    damping: float
    """Fraction of the critical damping, above 0, up to 10: below 1 the drive overshoots and rings, from 1 on it
    creeps."""
    from_: float = 0.0
    """Fraction of the travel, 0 to 1: the position before the first step."""
    to: float = 1.0
    """Fraction of the travel, 0 to 1: the position after the last step."""
    dwell_s: float | None = None
    """Seconds, above 0, or the recording divided evenly: the time between two steps; after the last step the lens
    rests."""

    def __post_init__(self) -> None:
        check_endpoints(self.from_, self.to)
        if isinstance(self.count, bool) or not (isinstance(self.count, int) and 1 <= self.count <= MAX_STEPS):
            raise BadInput(
                f"count is {self.count!r}",
                allowed=f"a whole number of steps, 1 to {MAX_STEPS}; to draw one, write {{choice: [4, 8]}}",
            )
        check_bounds("natural_hz", self.natural_hz, low=0, high=1e5, unit="Hz")
        check_bounds("damping", self.damping, low=0, high=10, unit="of the critical damping")
        if self.dwell_s is not None:
            check_bounds("dwell_s", self.dwell_s, low=0, high=3600, unit="s")

    def positions(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the position at each time, a fraction of the travel.

        Raises BadInput if the recording ends before the last step.
        """
        dwell = duration_s / (self.count + 1) if self.dwell_s is None else self.dwell_s
        if not 0 < self.count * dwell < duration_s:
            raise BadInput(
                f"{self.count} steps, one per {dwell:g} s, in a recording of {duration_s:g} s",
                allowed=f"dwell_s above 0 and below {duration_s / self.count:g}",
                hint="leave dwell_s out to divide the recording evenly",
            )
        seconds = np.asarray(seconds, dtype=np.float64)
        begins = np.arange(self.count + 1) * dwell
        step = np.maximum(np.searchsorted(begins, seconds, side="right") - 1, 0)
        off, speed = self._states(dwell)
        of_off, of_speed = self._ringing(seconds - begins[step])
        command = self.from_ + (self.to - self.from_) * (step / self.count)
        return np.clip(command + off[step] * of_off + speed[step] * of_speed, 0.0, 1.0)

    def _states(self, dwell: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the offset from the new position and the speed at the beginning of each step, each (count + 1,)."""
        height = (self.to - self.from_) / self.count
        omega = 2 * pi * self.natural_hz
        a, b = (float(x) for x in self._ringing(np.asarray(dwell)))
        states = [(0.0, 0.0)]
        for _ in range(self.count):
            off, speed = states[-1]
            next_speed = -(omega**2) * b * off + (a - 2 * self.damping * omega * b) * speed
            states.append((a * off + b * speed - height, next_speed))
        off_all, speed_all = np.array(states).T
        return off_all, speed_all

    def _ringing(self, seconds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return x of the free oscillator after ``seconds`` for two starts: x = 1 at rest, and x = 0 with speed 1."""
        omega, damping = 2 * pi * self.natural_hz, self.damping
        if damping <= 1:
            turn = omega * sqrt(1 - damping**2)
            decay = np.exp(-damping * omega * seconds)
            wave, of_speed = decay * np.cos(turn * seconds), decay * seconds * np.sinc(turn * seconds / pi)
        else:
            split = omega * sqrt(damping**2 - 1)
            slow = np.exp(-omega / (damping + sqrt(damping**2 - 1)) * seconds)  # ω(ζ - √(ζ² - 1))
            closing = -np.expm1(-2 * split * seconds)
            wave, of_speed = slow * (1 - closing / 2), slow * closing / (2 * split)
        return wave + damping * omega * of_speed, of_speed
