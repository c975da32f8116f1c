"""Top of a focus curve on which two measures agree: the second measure is not blind to fine patterns."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._light_windows import LightWindow, equal_light_windows
from saf_gen.plugins.searches._score_curve import ScoreCurve
from saf_gen.plugins.searches._windows import check_frame_count, check_numbers

WITNESS = "split_gradient"
SHORTEST = 4
"""Frames of the shortest step; a short recording has fewer steps."""
SMOOTH = 1.5
"""Width of the Gaussian that smooths both curves, in steps."""
FEWEST = 8
"""Scores that a sweep needs before it can stop."""
FALLEN = (0.25, 0.1), (0.5, 0.2)
"""Fractions of its range and of its largest value by which each curve must have fallen before the sweep stops."""
RISEN = 0.05
"""Fraction of its range by which each curve must have risen before."""
ALIKE = 1.5
"""Ratio of light up to which windows have about the same fixed pattern."""
BELL_ABOVE, ROUGH = 0.4, 0.1
"""Options ``above`` and ``rough`` of peak_fit, whose bell is fitted if one side of the peak is missing."""
BLOCKS = 4
"""Blocks of a picture along each axis that vote."""


@dataclass(frozen=True)
class AgreedPeak:
    """Answers with the top of the focus curve, or with that of a second curve if the first is blind, and stops early.

    Windows have equal light, as in ``peak_fit``: after each of ``steps`` steps, the window that ends there is the
    shortest one with ``counts`` spikes per pixel, but no longer than the fraction ``longest`` of the recording. A
    recording with fewer than four frames per step has fewer steps. Each window is scored by the method's measure and by
    ``split_gradient``, and both curves are smoothed by a Gaussian of 1.5 steps.

    A measure of structure, such as ``octave_quotient``, is steep and hardly follows the light, but it is blind to
    patterns with a single fine period. ``split_gradient`` follows any texture, and the light as well. If their peaks
    are at most the fraction ``near`` of the sweep apart, the first measure answers. If not, the better conditioned one
    does: ``split_gradient`` if its peak is ``clear`` times its median and stands out of its scatter by ``clear`` times
    that, since a fine pattern leaves nothing once it is blurred, and if all 4 × 4 blocks of the picture are sharper
    there, since peaks differ as well if the target has several depths; otherwise the method's measure.

    The focus is the highest point of a polynomial of third order, which may be skew, through the scores around the
    largest that stay above the fraction ``above`` of the curve's range. The search abstains if the curve does not fall
    by ``fall`` of its range, and by twice its scatter, on both sides of its largest value.

    The sweep stops once both curves have risen and fallen, for longer than a window: the first by a quarter of its
    range and a tenth of its largest value, the second, which is narrower, by twice as much. Then blocks vote: the sweep
    goes on unless most of the 4 × 4 blocks of the picture that changed clearly were sharper at the peak than they are
    now. A nearer object in the box that comes into focus first does therefore not stop it.

    Each step takes one score of the light and one of each measure. The trace holds the frame of the largest score so
    far, whenever it changes, in frames from 0.

    References
    ----------
    This project. Stop: as ``photon_aware``.
    """

    counts: float = 6.0
    steps: int = 80
    longest: float = 0.15
    near: float = 0.03
    clear: float = 4.0
    above: float = 0.6
    fall: float = 0.03
    stand_out: float = 3.0

    causal: ClassVar[bool] = True
    measures: ClassVar[tuple[str, ...]] = ("er_count", "er_count_n", WITNESS)

    def __post_init__(self) -> None:
        check_frame_count("steps", self.steps)
        fractions = dict.fromkeys(("longest", "near", "above", "fall"), 1.0)
        check_numbers(self, {"counts": 1e6, "clear": 1e6, "stand_out": 1e6, **fractions})

    def __call__(self, view: View) -> Answer:
        """Return the answer for a sweep; raise BadInput if it has fewer than two frames."""
        steps = max(min(self.steps, view.frames // SHORTEST), 1)
        curves = [ScoreCurve(SMOOTH * (view.frames // steps), steps) for _ in range(2)]
        windows: list[LightWindow] = []
        scores: list[tuple[float, float]] = []
        trace: list[float] = []
        fallen = 0
        for window in equal_light_windows(view, self.counts, steps=steps, longest=self.longest):
            windows.append(window)
            scores.append((view.score(window.first, window.stop), view.score(window.first, window.stop, WITNESS)))
            for curve, score in zip(curves, scores[-1], strict=True):
                curve.add((window.first + window.stop) / 2 - 0.5, score)
            best = curves[0].best()
            if not trace or trace[-1] != best:
                trace.append(best)
            fell = all(curve.has_fallen(*least) for curve, least in zip(curves, FALLEN, strict=True))
            fallen = fallen + 1 if fell else 0
            if fallen > max(2, window.steps) and all(curve.is_peak(RISEN) for curve in curves):
                chosen = self._choose(view, curves, scores=scores, windows=windows)
                if blocks_prefer(view, windows[curves[chosen].smoothed.argmax()], over=window, least=0.25):
                    break
        note = f"stopped after {view.now} of {view.frames} frames"
        if len(windows) < FEWEST:
            return Answer(None, tuple(trace), "too dark")
        chosen = self._choose(view, curves, scores=scores, windows=windows)
        x, y = curves[chosen].frames, curves[chosen].smoothed
        k, spread = int(y.argmax()), scatter([score[chosen] for score in scores], windows)
        fall = min(y[k] - y[: k + 1].min(), y[k] - y[k:].min())
        if not fall > max(self.fall * np.ptp(y), self.stand_out * spread):
            found = bell_top(x, np.array(scores)[:, chosen], light=np.array([window.light for window in windows]))
            if found is not None and 0 <= found < view.frames:
                return Answer(found, tuple(trace), f"{note}, at an end of it")
            return Answer(None, tuple(trace), f"{note}: no focus in it, the curve has no peak that stands out")
        frame = skew_top(x, y, above=self.above)
        return Answer(frame, tuple(trace), f"{note}, by {WITNESS}" if chosen else note)

    def _choose(
        self, view: View, curves: list[ScoreCurve], *, scores: list[tuple[float, float]], windows: list[LightWindow]
    ) -> int:
        """Return 1 if the peak of the second curve is to be believed and the first one is elsewhere, otherwise 0."""
        first, second = (curve.best() for curve in curves)
        if abs(first - second) <= self.near * view.frames:
            return 0
        y, rate = curves[1].smoothed, np.array([window.light / (window.stop - window.first) for window in windows])
        alike = np.abs(np.log(rate / rate[y.argmax()])) < np.log(ALIKE)  # the fixed pattern grows as the light fades
        middle, spread = float(np.median(y[alike])), scatter([score[1] for score in scores], windows)
        if y.max() <= self.clear * max(middle, 0.0) or y.max() - middle <= self.clear * spread:
            return 0
        blind, witness = (windows[curve.smoothed.argmax()] for curve in curves)
        return int(blocks_prefer(view, witness, over=blind, least=1.0))


def scatter(scores: list[float], windows: list[LightWindow]) -> float:
    """Return the standard deviation of scores, from the median second difference of windows that share no frame.

    The focus bends the curve as well, but only in few windows. The result is infinite if there are no three of them.
    """
    y = np.array(scores)
    later = np.searchsorted([window.first for window in windows], [window.stop for window in windows])
    i = np.flatnonzero(later < len(y))
    i = i[later[later[i]] < len(y)]
    bends = y[i] - 2 * y[later[i]] + y[later[later[i]]]
    return 1.48 / 6**0.5 * float(np.median(np.abs(bends))) if len(i) else np.inf


def skew_top(x: np.ndarray, y: np.ndarray, *, above: float) -> float:
    """Return the place of the top of a cubic through the scores y at x around the largest, (n,), x in order.

    The scores are those that stay above the fraction ``above`` of the range, at least two on each side if there are.
    """
    k = int(y.argmax())
    low = np.flatnonzero(y <= y.min() + above * np.ptp(y))
    place = np.searchsorted(low, k)
    begin = min(low[place - 1] + 1 if place else 0, max(k - 2, 0))
    stop = max(low[place] if place < len(low) else len(y), min(k + 3, len(y)))
    if stop - begin < 5:
        return float(x[k])
    scale = np.ptp(x[begin:stop])
    shape = np.polynomial.Polynomial.fit((x[begin:stop] - x[k]) / scale, y[begin:stop], 3)
    fine = np.linspace(x[begin], x[stop - 1], 401)
    return float(fine[shape((fine - x[k]) / scale).argmax()])


def bell_top(x: np.ndarray, y: np.ndarray, *, light: np.ndarray) -> float | None:
    """Return the top of the bell through scores y at x, as ``peak_fit`` does, or None if they do not form one.

    ``light`` holds the spikes per pixel of the windows; all are (n,), and x is in order.
    """
    k = int(y.argmax())
    low = np.flatnonzero(y <= BELL_ABOVE * y[k])
    place = np.searchsorted(low, k)
    part = slice(low[place - 1] + 1 if place else 0, low[place] if place < len(low) else len(y))
    x, y, light = x[part], y[part], light[part]
    if len(x) < FEWEST or y.min() <= 0:
        return None
    t, weights = (x - x.mean()) / np.ptp(x), y * y * np.sqrt(light / light.max())
    shape = np.polynomial.Polynomial.fit(t, 1 / y, 2, w=weights, domain=[-1, 1])
    level, slope, bend = (float(c) for c in shape.coef)
    if bend <= 0 or level <= slope * slope / (4 * bend):
        return None  # 1/y is not a parabola with a minimum above zero
    misfit = np.sqrt(np.average((shape(t) * y - 1) ** 2, weights=weights) * len(x) / (len(x) - 3))
    return float(x.mean() - np.ptp(x) * slope / (2 * bend)) if misfit < ROUGH else None


def blocks_prefer(view: View, one: LightWindow, *, over: LightWindow, least: float) -> bool:
    """Return whether most blocks of the picture that differ clearly are sharper in window ``one`` than in ``over``.

    They must be twice as many as those that are less sharp, and at least the fraction ``least`` of all blocks.
    Sharpness is the mean squared difference of neighbours over squared brightness. A clear difference is one of three
    standard errors, as if all of it were white noise.
    """
    (here, size), (there, _) = (block_gradients(view.counts(w.first, w.stop)) for w in (one, over))
    gain = (here - there) / (3 * np.sqrt(2 / size) * (here + there) / 2 + 1e-300)
    return bool(np.sum(gain > 1) >= max(2 * np.sum(gain < -1), least * BLOCKS**2))


def block_gradients(counts: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the mean squared difference of neighbours over squared brightness in each block, and the pixels of one."""
    parts = [np.array_split(rows, BLOCKS, axis=1) for rows in np.array_split(counts.astype(np.float64), BLOCKS)]
    energy = [
        (np.square(np.diff(b, axis=0)).mean() + np.square(np.diff(b)).mean()) / b.mean() ** 2
        if min(b.shape) > 1 and b.any()
        else 0.0
        for row in parts
        for b in row
    ]
    return np.array(energy), counts.size / BLOCKS**2
