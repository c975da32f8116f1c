"""The smoothed focus curve of a sweep that is running: its largest value, and whether it falls on both sides."""

import numpy as np


class ScoreCurve:
    """Up to ``capacity`` scores at frames, added one by one and smoothed by a Gaussian of ``width`` frames."""

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
        """Return whether the last smoothed score is well below the largest.

        The difference must exceed both the fraction ``of_range`` of the range of the scores and the fraction
        ``of_largest`` of the largest score.
        """
        y = self.smoothed
        return bool(y.max() - y[-1] > max(of_range * np.ptp(y), of_largest * abs(y.max())))

    def is_peak(self, of_range: float) -> bool:
        """Return whether the curve falls on both sides of its largest value by more than ``of_range`` of its range."""
        y, order = self.smoothed, np.argsort(self.frames, kind="stable")
        y = y[order]
        k, least = int(y.argmax()), of_range * np.ptp(y)
        return bool(min(y[k] - y[: k + 1].min(), y[k] - y[k:].min()) > least > 0)

    def top(self) -> float:
        """Return the frame of the top of a parabola fitted to the scores around the largest.

        If these scores are too few, or if the parabola has no top, return the frame of the largest score.
        """
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
