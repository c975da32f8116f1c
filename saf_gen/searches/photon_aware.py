"""Our own search: windows that hold enough spikes whatever the light, and an honest end."""

from dataclasses import dataclass
from math import isfinite
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.searches._golden_narrowing import check_frame_count

BROAD = "sd_calibrated"


@dataclass(frozen=True)
class PhotonAware:
    """Follows the sweep with trailing windows of equal light, stops where the focus has been passed.

    The score of a window is uncertain, and biased, by how few spikes it holds, so windows are cut by spikes
    and not by time: after each step (``steps`` of them in a recording) the window that ends there is the
    shortest with twice ``counts`` spikes a pixel, about ``counts`` in each half, and no longer than
    ``longest`` of the recording. Its score stands for its centre. Scores are smoothed by a Gaussian of
    ``smooth`` steps, and the answer is the top of the parabola through those round the largest.

    The sweep stops once the curve has come down from its largest value by ``until`` of its range and by
    ``least`` of that value, for longer than a window, having come up by half of that before; with ``far``
    that of ``sd_calibrated``, of the same windows, has to as well. A steep measure is close at the focus and
    has small tops of its own far from it, where contrast is still a broad hill. Where the curve has not come
    down by ``fall`` of its range on both sides of the largest value by the end, the focus is not in the
    sweep, and it abstains.

    Two to four scores a step, one of them by the method's own measure. The trace holds the largest so far,
    0-based frames, whenever it moves.
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
    source: ClassVar[str] = (
        "ours; it stops as SGFS should: Su et al., Intensity-Robust Autofocus for Spike Camera, CVPR 2024, "
        "doi:10.1109/CVPR52733.2024.02363, Algorithm 1"
    )

    def __post_init__(self) -> None:
        check_frame_count(self.steps, "steps")
        shares = {
            "longest": (0, 1),
            "until": (0, 1),
            "least": (0, 1),
            "fall": (0, 1),
            "smooth": (0, 100),
            "counts": (0, 1e6),
        }
        for key, (least, most) in shares.items():
            value = getattr(self, key)
            if isinstance(value, bool) or not (isfinite(value) and least <= value <= most):
                raise BadInput(f"{key} is {value!r}", allowed=f"{least} to {most:g}")
        if not isinstance(self.far, bool):
            raise BadInput(f"far is {self.far!r}", allowed="true, false")

    def __call__(self, view: View) -> Answer:
        """Search the sweep. Raises BadInput where it has fewer than two frames a step."""
        step = view.frames // self.steps
        if step < 2:
            raise BadInput(
                f"a recording of {view.frames} frames is too short for {self.steps} steps",
                allowed=f"at least {2 * self.steps} frames",
                hint="choose fewer steps",
            )
        spikes, pixels = [0.0], 0.0
        curve = _Curve(self.smooth * step, self.steps + 1)
        curves = [curve, *([_Curve(self.smooth * step, self.steps + 1)] if self.far else [])]
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
            held = (spikes[k] - spikes[begin]) / pixels if pixels else 0.0
            if held < (2 * self.counts if k < most else self.counts / 2):
                continue  # not enough light yet; or hardly any at all
            for one, measure in zip(curves, (None, BROAD), strict=False):
                one.add((begin + k) * step / 2 - 0.5, view.score(begin * step, stop, measure))
            best = curve.best()
            if not trace or trace[-1] != best:
                trace.append(best)
            falling = falling + 1 if all(one.has_fallen(self.until, self.least) for one in curves) else 0
            if falling > max(2, k - begin) and all(one.is_a_peak(self.until / 2) for one in curves):
                break  # so long that no window of then shares a spike with the first of them
        note = f"stopped after {stop} of {view.frames} frames"
        if not trace:
            return Answer(None, (), "too dark")
        if not curve.is_a_peak(self.fall):
            return Answer(None, tuple(trace), f"{note}: no focus in it, the curve has no two sides")
        return Answer(curve.top(), tuple(trace), note)


class _Curve:
    """At most ``room`` scores at frames, as they come in, smoothed by a Gaussian of ``width`` frames."""

    def __init__(self, width: float, room: int) -> None:
        self._width, self._count = max(width, 1e-6), 0
        self._rows = np.zeros((4, room))  # frame, score, sum of weights, weighted sum

    @property
    def frames(self) -> np.ndarray:
        """(n,) where the scores stand."""
        return self._rows[0, : self._count]

    @property
    def smoothed(self) -> np.ndarray:
        """(n,)"""
        return self._rows[3, : self._count] / self._rows[2, : self._count]

    def add(self, frame: float, score: float) -> None:
        n = self._count
        frames, scores, weights, sums = self._rows[:, :n]
        share = np.exp(-(((frame - frames) / self._width) ** 2) / 2)
        weights += share
        sums += share * score
        self._rows[:, n] = frame, score, 1 + share.sum(), score + share @ scores
        self._count = n + 1

    def best(self) -> float:
        """The frame of the largest smoothed score."""
        return float(self.frames[self.smoothed.argmax()])

    def has_fallen(self, share: float, least: float) -> bool:
        """Whether the last score is below the largest by these shares of the range and of the largest."""
        y = self.smoothed
        return bool(y.max() - y[-1] > max(share * np.ptp(y), least * abs(y.max())))

    def is_a_peak(self, share: float) -> bool:
        """Whether the curve comes down by this share of its range on both sides of its largest value."""
        y, order = self.smoothed, np.argsort(self.frames, kind="stable")
        y = y[order]
        k, least = int(y.argmax()), share * np.ptp(y)
        return bool(min(y[k] - y[: k + 1].min(), y[k] - y[k:].min()) > least > 0)

    def top(self) -> float:
        """The top of the parabola through the scores round the largest; that one where it has no top."""
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
