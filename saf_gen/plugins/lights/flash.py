"""The flash of a xenon tube, which rises in a fraction of a millisecond and then decays."""

from dataclasses import dataclass
from math import exp, inf, log1p

import numpy as np

from saf_gen.errors import BadInput


@dataclass(frozen=True)
class Flash:
    """The gain is ``base``, plus a flash that begins at ``at_s`` and brings the gain up to ``peak``.

    With t counted from ``at_s``, the flash is (1 - exp(-t/``rise_s``)) · exp(-t/``decay_s``), scaled to the peak: the
    arc strikes, and then the capacitor discharges through the tube. With q = decay_s/rise_s, the unscaled shape is
    highest at t = rise_s·ln(1 + q), where it is q/(1 + q)^(1 + 1/q).
    """

    endless = True

    at_s: float
    """Seconds, 0 or more: the time at which the flash begins."""
    peak: float
    """Gain, ``base`` or more: the highest gain."""
    base: float = 1.0
    """Gain, 0 or more: the gain before and after the flash."""
    rise_s: float = 1e-4
    """Seconds, 1e-7 to 10: the time constant of the rise, 1 − exp(−t/rise_s)."""
    decay_s: float = 1e-3
    """Seconds, 1e-7 to 10: the time constant of the decay, exp(−t/decay_s)."""

    def __post_init__(self) -> None:
        if not 0 <= self.at_s < inf:
            raise BadInput(f"at_s is {self.at_s!r}", allowed="seconds from the beginning, 0 or more")
        if not 0 <= self.base <= self.peak < inf:
            raise BadInput(f"base is {self.base!r}, peak {self.peak!r}", allowed="gains with 0 <= base <= peak")
        for key in ("rise_s", "decay_s"):
            if not 1e-7 <= getattr(self, key) <= 10:
                raise BadInput(f"{key} is {getattr(self, key)!r}", allowed="1e-7 to 10 seconds")

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the integral of the gain from 0 to each time, in seconds."""
        seconds = np.asarray(seconds, dtype=np.float64)
        since = np.maximum(seconds - self.at_s, 0.0)
        # The shape is the difference of two decays: one at rate 1/decay_s, one at rate 1/decay_s + 1/rise_s.
        both_s = self.rise_s * self.decay_s / (self.rise_s + self.decay_s)
        area = both_s * np.expm1(-since / both_s) - self.decay_s * np.expm1(-since / self.decay_s)
        return self.base * seconds + (self.peak - self.base) / self._highest() * area

    def gain(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the gain at each time."""
        since = np.maximum(np.asarray(seconds, dtype=np.float64) - self.at_s, 0.0)
        shape = -np.expm1(-since / self.rise_s) * np.exp(-since / self.decay_s)
        return self.base + (self.peak - self.base) / self._highest() * shape

    def breaks(self, duration_s: float) -> np.ndarray:
        """Return the beginning of the flash, and times between which it decays by e⁴ at most, in seconds."""
        both_s = self.rise_s * self.decay_s / (self.rise_s + self.decay_s)
        decays = 4.0 * np.arange(11)  # to e⁻⁴⁰ of the flash, after which float64 has only the base
        return self.at_s + np.concatenate([both_s * decays, self.decay_s * decays])

    def _highest(self) -> float:
        """Return the height of the unscaled shape."""
        q = self.decay_s / self.rise_s
        return q / (1 + q) * exp(-log1p(q) / q)
