"""A recording with a given focus curve: every score is known, and none takes time."""

from functools import cache

import numpy as np

from saf_gen.benchmark.conformance._check_runner import CheckLimits
from saf_gen.benchmark.conformance._sample_counts import make_conformance_texture
from saf_gen.core.region import validate_window
from saf_gen.errors import BadInput
from saf_gen.parts import wants_frames, wants_halves
from saf_gen.plugins.measures import get_measure

MEAN_RATE = 0.2  # spikes per pixel and readout
SIZE = 16, 24


def conformance_bell_curve(frames: int, peak: float, *, width: float = 0.1) -> np.ndarray:
    """Return a Gaussian of height 1 at the fraction ``peak`` of a recording; it falls to 1/e in ``width``."""
    return np.exp(-(((np.arange(frames) / frames - peak) / width) ** 2))


class SyntheticRecording:
    """A recording as a saf_gen.parts.View in which a score is the mean of ``curve`` over the window.

    A measure that is asked for by name scores a texture of the window's length whose contrast follows the
    curve. ``unit`` multiplies the scores of the method's own measure, ``light`` is the mean rate, and
    ``seen`` is the end of the latest window or position that was looked at.
    """

    readout_hz = 20_000.0
    lag_s = 0.0

    def __init__(
        self, curve: np.ndarray, *, unit: float = 1.0, light: float = MEAN_RATE, limits: CheckLimits | None = None
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
        self._limits.check_scores(self.scores)
        self.seen = max(self.seen, window.stop)
        mean = float(self._sums[window.stop] - self._sums[window.start]) / len(window)
        return self._unit * mean if measure is None else self._score_texture(measure, mean, frames=len(window))

    def position(self, frame: int) -> float:
        validate_window(frame, frame + 1, total=self.frames)
        self.seen = max(self.seen, frame + 1)  # reading a later position looks ahead
        return frame / max(self.frames - 1, 1)

    def move(self, to: float) -> None:
        raise BadInput(f"the lens of a recording cannot be moved to {to}")

    def wait(self, frames: int) -> None:
        raise BadInput(f"the lens of a recording cannot go on for {frames} frames")

    def _score_texture(self, name: str, mean: float, *, frames: int) -> float:
        measure = _measure(name)
        contrast = (mean - self._lowest) / self._range if self._range else 0.0
        counts = self._light * frames * (1 + contrast * (make_conformance_texture(*SIZE) - 1))
        given = np.stack([counts, counts]) / 2 if wants_halves(measure) else counts
        if wants_frames(measure):
            return measure(given, frames=frames)  # type: ignore[call-arg]
        return measure(given)


_measure = cache(get_measure)
