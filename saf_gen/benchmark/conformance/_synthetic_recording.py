"""A synthetic recording with a given focus curve, in which every score is known and takes no time."""

from functools import cache

import numpy as np

from saf_gen.benchmark.conformance._check_runner import CheckLimits
from saf_gen.benchmark.conformance._sample_counts import sample_texture
from saf_gen.core.region import validate_window
from saf_gen.errors import BadInput
from saf_gen.parts import wants_frames, wants_halves
from saf_gen.plugins.measures import get_measure

MEAN_RATE = 0.2  # spikes per pixel and readout
SIZE = 16, 24


def bell(frames: int, peak: float, *, width: float = 0.1) -> np.ndarray:
    """Return a Gaussian focus curve of height 1, one value per frame.

    The peak is at the fraction ``peak`` of the recording; at the distance ``width``, also a fraction of the recording,
    the curve has fallen to 1/e.
    """
    return np.exp(-(((np.arange(frames) / frames - peak) / width) ** 2))


class SyntheticRecording:
    """A :class:`saf_gen.parts.View` of a recording in which each score is the mean of ``curve`` over the window.

    Measures that the search names score counts, which are a texture whose contrast follows the curve.

    Parameters
    ----------
    curve : ndarray of float
        Focus curve, one value per frame.
    unit : float, optional
        Factor by which scores of the method's own measure are multiplied.
    light : float, optional
        Mean rate, in spikes per pixel and readout.
    limits : CheckLimits, optional
        Limits on the number of scores.

    Attributes
    ----------
    seen : int
        Number of frames up to the last one that was looked at.
    scores : int
        Number of windows that were scored or looked at.
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
        mean, frames = self._look(first, stop)
        if measure is None:
            return self._unit * mean
        scorer, counts = _measure(measure), self._make_texture(mean, frames=frames)
        scored_counts = np.stack([counts, counts]) / 2 if wants_halves(scorer) else counts
        if wants_frames(scorer):
            return scorer(scored_counts, frames=frames)  # type: ignore[call-arg]
        return scorer(scored_counts)

    def counts(self, first: int, stop: int) -> np.ndarray:
        mean, frames = self._look(first, stop)
        return np.rint(self._make_texture(mean, frames=frames)).astype(np.uint32)

    def position(self, frame: int) -> float:
        validate_window(frame, frame + 1, total=self.frames)
        self.seen = max(self.seen, frame + 1)  # reading a later position looks ahead
        return frame / max(self.frames - 1, 1)

    def move(self, to: float) -> None:
        raise BadInput(f"the lens of a recording cannot be moved to {to}")

    def wait(self, frames: int) -> None:
        raise BadInput(f"the lens of a recording cannot wait for {frames} frames")

    def _look(self, first: int, stop: int) -> tuple[float, int]:
        """Return the mean of the curve over a window, and the number of its frames."""
        window = validate_window(first, stop, total=self.frames)
        self.scores += 1
        self._limits.check_scores(self.scores)
        self.seen = max(self.seen, window.stop)
        return float(self._sums[window.stop] - self._sums[window.start]) / len(window), len(window)

    def _make_texture(self, mean: float, *, frames: int) -> np.ndarray:
        contrast = (mean - self._lowest) / self._range if self._range else 0.0
        return self._light * frames * (1 + contrast * (sample_texture(*SIZE) - 1))


_measure = cache(get_measure)
