"""Peak fit: the bell of the focus curve, fitted while the lens passes, tells the focus, passed or just outside."""

from dataclasses import dataclass
from math import isfinite
from typing import ClassVar, NamedTuple

import numpy as np

from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._light_windows import follow_windows_of_equal_light
from saf_gen.plugins.searches._numbers import check_search_numbers
from saf_gen.plugins.searches._score_curve import ScoreCurve
from saf_gen.plugins.searches._windows import check_search_frame_count

BROAD = "sd_calibrated"
LEAST_SCORES = 8
"""A bell needs as many scores: noise alone hardly ever puts so many neighbours on one."""
SMOOTH, UNTIL, LEAST, FALL = 2.0, 0.5, 0.2, 0.03
"""What photon_aware asks of a curve that is no bell: its options ``smooth``, ``until``, ``least`` and ``fall``."""


class Bell(NamedTuple):
    """A curve of height/(1 + ((x − focus)/width)²) over lens positions x."""

    focus: float
    width: float
    misfit: float
    """Root mean square of the relative residuals, per degree of freedom; those near the top weigh more."""


@dataclass(frozen=True)
class PeakFit:
    """Fits the bell of the focus curve while the lens passes it, and stops as soon as its top lies behind the lens.

    The blur of a flat target is linear in the position x of the lens, and the energy of the gradients of a texture with
    the spectrum of natural scenes (1/f²) falls with the square of a large blur. So the curve is a bell near the focus,
    y = a/(1 + ((x − x₀)/w)²), and 1/y is a parabola: linear least squares find the focus x₀ and the half width w, from
    one side of the bell too.

    Windows are cut by light: after each of the ``steps`` of a recording, the window that ends there is the shortest
    with ``counts`` spikes per pixel, no longer than ``longest`` of the recording. Its score belongs to the mean
    position of the lens in it. The fit takes the scores round the largest, in order of position, as far as they stay
    above ``above`` of it. Its weights are those of scores with equal errors, more where a window holds more spikes.

    A bell is believed if its misfit, the relative residual, is below ``rough``. The search stops when for three windows
    the lens has been behind the top by (``beyond`` + ``doubt``·misfit)·w, and was before it by as much; in a sweep that
    began nearer than that, if the misfit is below a quarter of ``rough``. Some score must lie below ``low`` of the
    largest. While no bell is believed it stops where ``photon_aware`` would, for a curve need not be a bell.

    The answer is the frame at which the lens was nearest to x₀. It may lie up to ``reach``·w outside of what the lens
    passed: on most scenes w is 1.2 to 2.2 depths of focus for ``structure_calibrated`` and 1.9 to 3.8 for
    ``octave_structure``, so that the end of the sweep is about in focus. Without a bell the answer is that of
    ``photon_aware``, which abstains from a curve without two sides. Where positions of the lens are not recorded,
    frames stand for them.

    Choose a measure without a floor of noise: ``octave_structure`` needs no calibration either. Three scores per step,
    one of them by the method's own measure. The trace holds the frame of the focus so far, whenever it moves.

    References
    ----------
    This project. Blur is linear in the lens's drive: M. Subbarao, G. Surya, Int. J. Comput. Vision 13, 1994,
    doi:10.1007/BF02028349. Spectra of natural scenes: D. J. Field, J. Opt. Soc. Am. A 4, 1987,
    doi:10.1364/JOSAA.4.002379.
    """

    counts: float = 6.0
    steps: int = 200
    longest: float = 0.1
    above: float = 0.4
    beyond: float = 0.15
    doubt: float = 8.0
    low: float = 0.5
    rough: float = 0.1
    reach: float = 0.55

    causal: ClassVar[bool] = True
    measures: ClassVar[tuple[str, ...]] = ("er_count", "er_count_n", BROAD)

    def __post_init__(self) -> None:
        check_search_frame_count("steps", self.steps)
        fractions = dict.fromkeys(("longest", "above", "low", "rough"), 1.0)
        check_search_numbers(self, {"counts": 1e6, "beyond": 10, "doubt": 1e3, "reach": 10, **fractions})

    def __call__(self, view: View) -> Answer:
        """Search the sweep. Raise BadInput where it has fewer than two frames per step."""
        step = view.frames // self.steps
        lens: list[float] = []  # in the middle of each step so far
        rows: list[tuple[float, float, float]] = []  # of each window: lens position, score, spikes per pixel
        curve, broad = (ScoreCurve(SMOOTH * step, self.steps) for _ in range(2))
        trace: list[float] = []
        bell, passed, fallen = None, 0, 0
        for first, stop, light, steps in follow_windows_of_equal_light(
            view, self.counts, steps=self.steps, longest=self.longest
        ):
            while len(lens) < stop // step:
                lens.append(_lens_position(view, len(lens) * step + step // 2))
            middle, score = (first + stop) / 2 - 0.5, view.score(first, stop)
            rows.append((float(np.mean(lens[first // step :])), score, light))
            curve.add(middle, score)
            broad.add(middle, view.score(first, stop, BROAD))
            x, y, spikes = np.array(rows).T
            bell = fit_bell(x, y, light=spikes, above=self.above)
            if bell and bell.misfit >= self.rough:
                bell = None
            best = curve.best() if bell is None else frame_nearest(bell.focus, lens, step=step)
            if not trace or trace[-1] != best:
                trace.append(best)
            passed = passed + 1 if bell and self._is_behind(bell, lens, rows=rows) else 0
            fallen = fallen + 1 if all(each.has_fallen(UNTIL, LEAST) for each in (curve, broad)) else 0
            fell = fallen > max(2, steps) and all(each.is_peak(UNTIL / 2) for each in (curve, broad))
            if passed == 3 or (fell and bell is None):
                break
        note = f"stopped after {view.now} of {view.frames} frames"
        if not rows:
            return Answer(None, (), "too dark")
        if bell and max(min(lens) - bell.focus, bell.focus - max(lens)) <= self.reach * bell.width:
            return Answer(frame_nearest(bell.focus, lens, step=step), tuple(trace), note)
        if curve.is_peak(FALL):
            return Answer(curve.top(), tuple(trace), note)
        return Answer(None, tuple(trace), f"{note}: no focus in it, the curve has no two sides")

    def _is_behind(self, bell: Bell, lens: list[float], *, rows: list[tuple[float, float, float]]) -> bool:
        """Return whether the lens has passed the top of a bell, and had come from its other side."""
        margin = (self.beyond + self.doubt * bell.misfit) * bell.width
        way = np.sign(lens[-1] - bell.focus)
        before = max(way * (bell.focus - x) for x in lens)
        began_near = before > 0 and abs(lens[0] - bell.focus) < margin and bell.misfit < self.rough / 4
        scores = [score for _, score, _ in rows]
        return bool(
            way * (rows[-1][0] - bell.focus) > margin
            and (before > margin or began_near)
            and min(scores) < self.low * max(scores)
        )


def fit_bell(x: np.ndarray, y: np.ndarray, *, light: np.ndarray, above: float) -> Bell | None:
    """Return the bell through scores y at lens positions x, or None where they make none.

    All are (n,); ``light`` holds the spikes per pixel of their windows. The bell is that of the scores round the
    largest, in order of position, as far as they stay above this fraction of it.
    """
    order = np.argsort(x, kind="stable")
    x, y, light = x[order], y[order], light[order]
    best = int(y.argmax())
    lower = np.flatnonzero(y <= above * y[best])
    first = np.searchsorted(lower, best)
    begin = lower[first - 1] + 1 if first else 0
    stop = lower[first] if first < len(lower) else len(x)
    x, y, light = x[begin:stop], y[begin:stop], light[begin:stop]
    if len(x) < LEAST_SCORES or y.min() <= 0 or np.ptp(x) <= 0:
        return None
    centre, scale = x.mean(), np.ptp(x)
    powers = np.vander((x - centre) / scale, 3)
    weights = y * y * np.sqrt(light / light.max())  # the error of 1/y is that of y over y²
    (bend, slope, level), _, rank, _ = np.linalg.lstsq(powers * weights[:, None], weights / y, rcond=1e-6)
    if rank < 3 or bend <= 0 or (least := level - slope * slope / (4 * bend)) <= 0:
        return None  # the lens rested, or 1/y is no parabola that opens upwards from above zero
    residuals = powers @ (bend, slope, level) * y - 1
    misfit = np.sqrt(np.average(residuals**2, weights=weights) * len(x) / (len(x) - 3))
    return Bell(float(centre - scale * slope / (2 * bend)), float(scale * np.sqrt(least / bend)), float(misfit))


def frame_nearest(position: float, lens: list[float], *, step: int) -> float:
    """Return the frame at which the lens, known in the middle of each step, was nearest to a position."""
    x = np.asarray(lens)
    k = int(np.abs(x - position).argmin())
    middle = k * step + (step - 1) / 2
    for other in (k - 1, k + 1):
        if 0 <= other < len(x) and (x[other] - position) * (x[k] - position) < 0:
            return float(middle + (other - k) * step * (position - x[k]) / (x[other] - x[k]))
    return float(middle)


def _lens_position(view: View, frame: int) -> float:
    """Return the lens position at a frame; where it is unknown the frame itself, as a fraction of all."""
    position = view.position(frame)
    return position if isfinite(position) else frame / view.frames
