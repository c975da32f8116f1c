"""A flash as of a xenon tube: up in a fraction of a millisecond, then dying away."""

from dataclasses import dataclass
from math import exp, inf, log1p

import numpy as np

from saf_gen.errors import BadInput


@dataclass(frozen=True)
class Flash:
    """Gain ``base``, and from ``at_s`` on a flash on top of it whose highest gain is ``peak``.

    With t from ``at_s`` its shape is (1 - exp(-t/``rise_s``)) · exp(-t/``decay_s``): the arc takes a
    moment to strike, then the capacitor empties through the tube. With q = decay_s/rise_s it is highest at
    rise_s·ln(1 + q), where it reaches q/(1 + q)^(1 + 1/q); ``peak`` is scaled to that.
    """

    at_s: float
    peak: float
    base: float = 1.0
    rise_s: float = 1e-4
    decay_s: float = 1e-3

    def __post_init__(self) -> None:
        if not 0 <= self.at_s < inf:
            raise BadInput(f"at_s is {self.at_s!r}", allowed="seconds from the beginning, 0 or more")
        if not 0 <= self.base <= self.peak < inf:
            raise BadInput(
                f"base is {self.base!r}, peak {self.peak!r}", allowed="gains with 0 <= base <= peak"
            )
        for key in ("rise_s", "decay_s"):
            if not 1e-7 <= getattr(self, key) <= 10:
                raise BadInput(f"{key} is {getattr(self, key)!r}", allowed="1e-7 to 10 seconds")

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Gain seconds from 0 to each time."""
        seconds = np.asarray(seconds, dtype=np.float64)
        since = np.maximum(seconds - self.at_s, 0.0)
        # The shape is the difference of two decays: decay_s alone, and both together.
        both_s = self.rise_s * self.decay_s / (self.rise_s + self.decay_s)
        area = both_s * np.expm1(-since / both_s) - self.decay_s * np.expm1(-since / self.decay_s)
        q = self.decay_s / self.rise_s
        highest = q / (1 + q) * exp(-log1p(q) / q)
        return self.base * seconds + (self.peak - self.base) / highest * area
