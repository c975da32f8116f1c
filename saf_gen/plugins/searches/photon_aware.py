"""Photon-aware search: windows of equal light, and a stop once the focus has been passed."""

from dataclasses import dataclass
from math import isfinite
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._windows import check_search_frame_count

BROAD = "sd_calibrated"


@dataclass(frozen=True)
class PhotonAware:
    """Follows the sweep with trailing windows of equal light, and stops where the focus has been passed.

    The score of a window is uncertain, and biased, by how few spikes it holds, so windows are cut by spikes
    and not by time: after each of the ``steps`` of a recording, the window that ends there is the shortest
    with twice ``counts`` spikes per pixel, about ``counts`` in each half, and no longer than ``longest`` of
    the recording. Its score belongs to its centre. Scores are smoothed by a Gaussian of ``smooth`` steps, and
    the answer is the top of the parabola through those around the largest.

    The sweep stops once the curve has stayed, for longer than a window, below its largest value by ``until`` of its
    range and ``least`` of that value, and has both risen and fallen by ``until``/2 of its range. With ``far`` the curve
    of ``sd_calibrated`` over the same windows must have done so too: a steep measure has small local maxima far from
    the focus, where contrast is still a broad hill. If the curve does not fall by ``fall`` of its range on both sides
    of the largest value, the focus is not in the sweep, and the search abstains.

    Two to four scores per step, one of them by the method's own measure. The trace holds the frame (0-based) of the
    largest value so far, whenever it moves.

    References
    ----------
    This project; it stops as SGFS should: Algorithm 1 of Su et al., "Intensity-Robust Autofocus for Spike
    Camera", CVPR 2024, doi:10.1109/CVPR52733.2024.02363.
    """

    counts: float = 6.0
    steps: int = 200
    longest: float = 0.15
    smooth: float = 2.0
    until: float = 0.5
    least: float = 0.2
    fall: float = 0.03
    far: bool = True

    causal: ClassVar[bool] = True
    measures: ClassVar[tuple[str, ...]] = ("er_count", "er_count_n", BROAD)

    def __post_init__(self) -> None:
        check_search_frame_count("steps", self.steps)
        highest = {"longest": 1, "until": 1, "least": 1, "fall": 1, "smooth": 100, "counts": 1e6}
        for key, most in highest.items():
            value = getattr(self, key)
            if isinstance(value, bool) or not (isfinite(value) and 0 <= value <= most):
                raise BadInput(f"{key} is {value!r}", allowed=f"0 to {most:g}")
        if not isinstance(self.far, bool):
            raise BadInput(f"far is {self.far!r}", allowed="true, false")

    def __call__(self, view: View) -> Answer:
        """Search the sweep. Raise BadInput where it has fewer than two frames per step."""
        step = view.frames // self.steps
        if step < 2:
            raise BadInput(
                f"a recording of {view.frames} frames is too short for {self.steps} steps",
                allowed=f"at least {2 * self.steps} frames",
                hint="choose fewer steps",
            )
        spikes, pixels = [0.0], 0.0
        curves = [_Curve(self.smooth * step, self.steps + 1) for _ in range(2 if self.far else 1)]
        curve = curves[0]
        falling = 0
        trace: list[float] = []
        most = max(int(self.longest * self.steps), 2)
        for k in range(1, self.steps + 1):
            stop = k * step
            spikes.append(spikes[-1] + view.score(stop - step, stop, "er_count"))
            pixels = pixels or view.score(stop - step, stop, "er_count_n")
            begin = k - 1
            while begin > max(k - most, 0) and spikes[k] - spikes[begin] < 2 * self.counts * pixels:
                begin -= 1
            counts = (spikes[k] - spikes[begin]) / pixels if pixels else 0.0
            if counts < (2 * self.counts if k < most else self.counts / 2):
                continue  # not enough light yet; or hardly any at all
            for each, measure in zip(curves, (None, BROAD), strict=False):
                each.add((begin + k) * step / 2 - 0.5, view.score(begin * step, stop, measure))
            best = curve.best()
            if not trace or trace[-1] != best:
                trace.append(best)
            falling = falling + 1 if all(each.has_fallen(self.until, self.least) for each in curves) else 0
            if falling > max(2, k - begin) and all(each.is_peak(self.until / 2) for each in curves):
                break  # for longer than a window, so that the first and the last share no spike
        note = f"stopped after {stop} of {view.frames} frames"
        if not trace:
            return Answer(None, (), "too dark")
        if not curve.is_peak(self.fall):
            return Answer(None, tuple(trace), f"{note}: no focus in it, the curve has no two sides")
        return Answer(curve.top(), tuple(trace), note)


class _Curve:
    """Up to ``capacity`` scores at frames, as they come in, smoothed by a Gaussian of ``width`` frames."""

    def __init__(self, width: float, capacity: int) -> None:
        self._width, self._count = max(width, 1e-6), 0
        self._rows = np.zeros((4, capacity))  # frame, score, sum of weights, weighted sum

    @property
    def frames(self) -> np.ndarray:
        """The frames of the scores, (n,)."""
        return self._rows[0, : self._count]

    @property
    def smoothed(self) -> np.ndarray:
        """The smoothed scores, (n,)."""
        return self._rows[3, : self._count] / self._rows[2, : self._count]

    def add(self, frame: float, score: float) -> None:
        n = self._count
        frames, scores, weights, sums = self._rows[:, :n]
        weight = np.exp(-(((frame - frames) / self._width) ** 2) / 2)
        weights += weight
        sums += weight * score
        self._rows[:, n] = frame, score, 1 + weight.sum(), score + weight @ scores
        self._count = n + 1

    def best(self) -> float:
        """Return the frame of the largest smoothed score."""
        return float(self.frames[self.smoothed.argmax()])

    def has_fallen(self, of_range: float, of_largest: float) -> bool:
        """Return whether the last score is below the largest by these fractions of the range and of it."""
        y = self.smoothed
        return bool(y.max() - y[-1] > max(of_range * np.ptp(y), of_largest * abs(y.max())))

    def is_peak(self, of_range: float) -> bool:
        """Return whether the curve falls by this fraction of its range on both sides of its largest value."""
        y, order = self.smoothed, np.argsort(self.frames, kind="stable")
        y = y[order]
        k, least = int(y.argmax()), of_range * np.ptp(y)
        return bool(min(y[k] - y[: k + 1].min(), y[k] - y[k:].min()) > least > 0)

    def top(self) -> float:
        """Return the top of the parabola through the scores around the largest, else the largest."""
        frames, y = self.frames, self.smoothed
        best = self.best()
        near = np.abs(frames - best) <= 2.5 * self._width
        x = (frames[near] - best) / self._width
        if len(np.unique(x)) < 3:
            return best
        bend, slope, _ = np.polyfit(x, y[near], 2)
        if bend >= 0:
            return best
        return best + float(np.clip(-slope / (2 * bend), x.min(), x.max())) * self._width
