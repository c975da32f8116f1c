"""A recording whose focus curve is drawn: every score is known, and none takes time."""

from functools import cache

import numpy as np

from saf_gen.benchmark.conformance._check_runner import CheckLimits, LimitExceededError
from saf_gen.benchmark.conformance._sample_counts import natural_texture
from saf_gen.core.region import validate_window
from saf_gen.errors import BadInput
from saf_gen.measures import get_measure
from saf_gen.parts import wants_frames, wants_halves

__all__ = ["SyntheticRecording", "gaussian_curve"]

MEAN_RATE = 0.2  # spikes a pixel and readout
SIZE = 16, 24


def gaussian_curve(frames: int, at: float, width: float = 0.1) -> np.ndarray:
    """A bell with its top, 1, at this share of the recording; ``width`` of it, to 1/e."""
    return np.exp(-(((np.arange(frames) / frames - at) / width) ** 2))


class SyntheticRecording:
    """What saf_gen.parts.View promises of a recording: a score is the mean of ``curve`` over the window.

    A measure asked for by name scores a picture of that many frames, whose contrast follows the curve.
    ``unit`` multiplies the scores of the method's own measure. ``seen`` is the end of what was asked for.
    """

    readout_hz = 20_000.0
    lag_s = 0.0

    def __init__(
        self,
        curve: np.ndarray,
        *,
        unit: float = 1.0,
        light: float = MEAN_RATE,
        limits: CheckLimits | None = None,
    ) -> None:
        self.frames, self._unit, self._light = len(curve), unit, light
        self._sums = np.concatenate([[0.0], np.cumsum(curve, dtype=np.float64)])
        self._lowest, self._range = float(curve.min()), float(np.ptp(curve))
        self._limits = limits or CheckLimits()
        self.seen, self.scores = 0, 0

    @property
    def now(self) -> int:
        return self.seen

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        window = validate_window(first, stop, total=self.frames)
        self.scores += 1
        if self.scores > self._limits.scores:
            raise LimitExceededError(f"did not end within {self._limits.scores:,} scores")
        self.seen = max(self.seen, window.stop)
        mean = float(self._sums[window.stop] - self._sums[window.start]) / len(window)
        return self._unit * mean if measure is None else self._named(measure, mean, len(window))

    def position(self, frame: int) -> float:
        validate_window(frame, frame + 1, total=self.frames)
        self.seen = max(self.seen, frame + 1)  # who asks where the lens will be looks ahead
        return frame / max(self.frames - 1, 1)

    def move(self, to: float) -> None:
        raise BadInput(f"the lens of a recording cannot be moved to {to}")

    def wait(self, frames: int) -> None:
        raise BadInput(f"the lens of a recording cannot go on for {frames} frames")

    def _named(self, name: str, mean: float, frames: int) -> float:
        part = _measure(name)
        contrast = (mean - self._lowest) / self._range if self._range else 0.0
        counts = self._light * frames * (1 + contrast * (natural_texture(*SIZE) - 1))
        given = np.stack([counts, counts]) / 2 if wants_halves(part) else counts
        return float(part(given, frames=frames) if wants_frames(part) else part(given))  # type: ignore[call-arg]


_measure = cache(get_measure)
