"""A focus ring turned by hand, at an uneven speed."""

from dataclasses import dataclass
from math import floor, sqrt

import numpy as np
from scipy.interpolate import make_interp_spline

from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput
from saf_gen.plugins.motions._option_checks import check_bounds, check_endpoints

POINTS_PER_PERIOD = 32  # per period of ``bandwidth_hz``; the speed is interpolated linearly between points


@dataclass(frozen=True)
class Hand:
    """The lens moves from ``from`` to ``to`` during the recording, at a speed that varies by ``irregularity``.

    The relative speed (the speed divided by its mean) has the standard deviation σ = ``irregularity``. It is computed
    from noise n of mean 0 and variance 1, a sum of random sines with a whole number of periods in the recording:

    - If ``reversals`` is true, the relative speed is 1 + σ·n, with frequencies up to ``bandwidth_hz``. The lens moves
      back a little in about Φ(-1/σ) of the time, as far as the stops at the ends of the travel allow.
    - If ``reversals`` is false, it is (1 + s·n)² divided by its mean, with frequencies up to half of ``bandwidth_hz``.
      The lens never moves back. With s² = √(2/(2 - σ²)) - 1, the standard deviation is σ for Gaussian n.

    The default bandwidth is below that of physiological tremor, 6 to 12 Hz [1]_. ``seed`` selects the noise; if a
    recipe gives no seed, each sequence gets a different one.

    References
    ----------
    .. [1] M. Lakie et al., The Journal of Physiology 593, 2015, doi:10.1113/JP270464.
    """

    from_: float = 0.0
    """Fraction of the travel, 0 to 1: the position at the beginning of the recording."""
    to: float = 1.0
    """Fraction of the travel, 0 to 1: the position at the end of the recording."""
    irregularity: float = 0.5
    """Fraction of the mean speed, above 0, up to 1: standard deviation of the speed."""
    bandwidth_hz: float = 5.0
    """Hz, above 0, up to 1,000: the highest frequency of the speed; at least one period must fit into the
    recording, or two if ``reversals`` is false."""
    reversals: bool = False
    """``true``, ``false``: whether the lens may move back a little."""
    seed: int = 0
    """Whole number, 0 or more: the same seed gives the same motion; if a recipe gives no seed, each sequence gets a
    different one."""

    def __post_init__(self) -> None:
        check_endpoints(self.from_, self.to)
        check_bounds("irregularity", self.irregularity, low=0, high=1, unit="of the mean speed")
        check_bounds("bandwidth_hz", self.bandwidth_hz, low=0, high=1000, unit="Hz")
        if not isinstance(self.reversals, bool):
            raise BadInput(f"reversals is {self.reversals!r}", allowed="true, false")
        if isinstance(self.seed, bool) or not isinstance(self.seed, int) or self.seed < 0:
            raise BadInput(f"seed is {self.seed!r}", allowed="a whole number, 0 or more")

    def positions(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the position at each time, a fraction of the travel.

        Raises BadInput if the recording is too short for ``bandwidth_hz``.
        """
        times, speed = self._speed(duration_s)
        path = make_interp_spline(times, speed, k=1).antiderivative()
        fraction = path(np.asarray(seconds, dtype=np.float64)) / path(duration_s)
        return np.clip(self.from_ + (self.to - self.from_) * fraction, 0.0, 1.0)

    def _speed(self, duration_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Return times in seconds, and the speed at these times up to a constant factor, each float64 (n,)."""
        periods = self.bandwidth_hz * duration_s
        waves = floor(periods * (1 if self.reversals else 0.5) + 1e-9)
        if waves < 1:
            lowest = (1 if self.reversals else 2) / duration_s
            raise BadInput(
                f"bandwidth_hz is {self.bandwidth_hz:g} in a recording of {duration_s:g} s",
                allowed=f"at least {lowest:g}, so that one period fits into the recording",
                hint="raise bandwidth_hz, or record more frames",
            )
        points = POINTS_PER_PERIOD * max(floor(periods), 1)
        coefficients = make_generator("hand", self.seed).standard_normal((waves, 2))
        coefficients /= sqrt(np.square(coefficients).sum() / 2)  # variance 1 over the recording
        spectrum = np.zeros(points // 2 + 1, dtype=np.complex128)
        spectrum[1 : waves + 1] = (coefficients[:, 0] - 1j * coefficients[:, 1]) * points / 2
        noise = np.fft.irfft(spectrum, points)
        noise = np.append(noise, noise[0])
        if self.reversals:
            speed = 1 + self.irregularity * noise
        else:
            speed = (1 + sqrt(sqrt(2 / (2 - self.irregularity**2)) - 1) * noise) ** 2
        return np.linspace(0, duration_s, points + 1), speed
