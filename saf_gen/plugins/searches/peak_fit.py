"""Peak fit: the bell of the focus curve, fitted while the lens passes, tells the focus, passed or just outside."""

from dataclasses import dataclass
from math import isfinite
from typing import ClassVar, NamedTuple

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._light_windows import follow_windows_of_equal_light
from saf_gen.plugins.searches._numbers import check_search_numbers
from saf_gen.plugins.searches._score_curve import ScoreCurve
from saf_gen.plugins.searches._windows import check_search_frame_count

BROAD, FINEST = "sd_calibrated", "vollath_f4_n"
LEAST_SCORES = 8
"""A bell needs as many scores: noise alone hardly ever puts so many neighbours on one."""
SMOOTH, UNTIL, LEAST, FALL = 2.0, 0.5, 0.2, 0.03
"""What photon_aware asks of a curve that is no bell: its options ``smooth``, ``until``, ``least`` and ``fall``."""
FINEST_WITHIN = 1.5
"""Half widths of a bell within which the finest differences are asked."""
BLOCKS, LIGHT_RATIO, MOST_DARK = 4, 1.3, 0.9
"""Blocks of a picture across and down, how much light must change to tell the dark, and what it may be of the least."""


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

    Spikes of the dark thin contrast out, the more the less light there is: where light changes, the curve does, and not
    for the focus. So the dark rate d is estimated while the search runs, from the contrast of coarse blocks of the
    picture, which the focus hardly changes and which the dark lowers to c·(1 − d/rate). What is fitted is the score
    over (1 − d/rate)²; with ``dark`` false, the score itself: for a measure that is calibrated.

    A bell is believed if its misfit, the relative residual, is below ``rough``. The search stops when for three windows
    the lens has been behind the top by (``beyond`` + ``doubt``·misfit)·w, and was before it by as much; in a sweep that
    began nearer than that, if the misfit is below a quarter of ``rough``. Some score must lie below ``low`` of the
    largest. While no bell is believed it stops where ``photon_aware`` would, for a curve need not be a bell.

    Then the top is fitted once more, by the measure of the finest differences, ``vollath_f4_n``, which other depths of
    the target reach less: its scores within 1.5·w of x₀, as far as they stay above ``near`` of their largest. Where
    that is a bell with a top within w of x₀, and within what the lens passed, its x₀ counts. With ``near`` 0 it is not
    asked.

    The answer is the frame at which the lens was nearest to x₀. It may lie up to ``reach``·w outside of what the lens
    passed: on most scenes w is 1.2 to 2.2 depths of focus for ``structure_calibrated`` and 1.9 to 3.8 for
    ``octave_structure``, so that the end of the sweep is about in focus. Without a bell the answer is that of
    ``photon_aware``, which abstains from a curve without two sides. Where positions of the lens are not recorded,
    frames stand for them.

    Choose a measure without a floor of noise: ``octave_structure`` needs no calibration either. Three scores per step,
    one of them by the method's own measure, a look at the counts, and some scores of the finest differences at the end.
    The trace holds the frame of the focus so far, whenever it moves.

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
    near: float = 0.5
    dark: bool = True

    causal: ClassVar[bool] = True
    measures: ClassVar[tuple[str, ...]] = ("er_count", "er_count_n", BROAD, FINEST)

    def __post_init__(self) -> None:
        check_search_frame_count("steps", self.steps)
        fractions = dict.fromkeys(("longest", "above", "low", "rough", "near"), 1.0)
        check_search_numbers(self, {"counts": 1e6, "beyond": 10, "doubt": 1e3, "reach": 10, **fractions})
        if not isinstance(self.dark, bool):
            raise BadInput(f"dark is {self.dark!r}", allowed="true, false")

    def __call__(self, view: View) -> Answer:
        """Search the sweep. Raise BadInput where it has fewer than two frames per step."""
        step = view.frames // self.steps
        lens: list[float] = []  # in the middle of each step so far
        windows: list[tuple[int, int]] = []
        rows: list[tuple[float, ...]] = []  # of each window: lens position, score, spikes per pixel, contrast of blocks
        curve, broad = (ScoreCurve(SMOOTH * step, self.steps) for _ in range(2))
        trace: list[float] = []
        bell, passed, fallen = None, 0, 0
        for first, stop, light, steps in follow_windows_of_equal_light(
            view, self.counts, steps=self.steps, longest=self.longest
        ):
            while len(lens) < stop // step:
                lens.append(_lens_position(view, len(lens) * step + step // 2))
            middle, score = (first + stop) / 2 - 0.5, view.score(first, stop)
            windows.append((first, stop))
            contrast = contrast_of_blocks(view.counts(first, stop)) if self.dark else 0.0
            rows.append((float(np.mean(lens[first // step :])), score, light, contrast))
            curve.add(middle, score)
            broad.add(middle, view.score(first, stop, BROAD))
            x, y, spikes, contrasts = np.array(rows).T
            rate = spikes / np.array([b - a for a, b in windows])
            undimmed = (1 - estimate_dark_rate(rate, contrasts) / rate) ** 2
            bell = fit_bell(x, y / undimmed, light=spikes, above=self.above)
            if bell and bell.misfit >= self.rough:
                bell = None
            best = curve.best() if bell is None else frame_nearest(bell.focus, lens, step=step)
            if not trace or trace[-1] != best:
                trace.append(best)
            passed = passed + 1 if bell and self._is_behind(bell, lens, x=x, y=y / undimmed) else 0
            fallen = fallen + 1 if all(each.has_fallen(UNTIL, LEAST) for each in (curve, broad)) else 0
            fell = fallen > max(2, steps) and all(each.is_peak(UNTIL / 2) for each in (curve, broad))
            if passed == 3 or (fell and bell is None):
                break
        note = f"stopped after {view.now} of {view.frames} frames"
        if not rows:
            return Answer(None, (), "too dark")
        if bell and max(min(lens) - bell.focus, bell.focus - max(lens)) <= self.reach * bell.width:
            finest = self._fit_finest(view, bell, windows=windows, x=x, undimmed=undimmed, light=spikes)
            focus = bell.focus if finest is None else finest.focus
            return Answer(frame_nearest(focus, lens, step=step), tuple(trace), note)
        if curve.is_peak(FALL):
            return Answer(curve.top(), tuple(trace), note)
        return Answer(None, tuple(trace), f"{note}: no focus in it, the curve has no two sides")

    def _fit_finest(
        self,
        view: View,
        bell: Bell,
        *,
        windows: list[tuple[int, int]],
        x: np.ndarray,
        undimmed: np.ndarray,
        light: np.ndarray,
    ) -> Bell | None:
        """Return the bell of the finest differences near the top of another, or None where they tell nothing."""
        if not self.near:
            return None
        inside = np.flatnonzero(np.abs(x - bell.focus) < FINEST_WITHIN * bell.width)
        if len(inside) < LEAST_SCORES:
            return None
        y = np.array([view.score(*windows[i], FINEST) for i in inside]) / undimmed[inside]
        found = fit_bell(x[inside], y, light=light[inside], above=self.near)
        if found is None or found.misfit >= self.rough or abs(found.focus - bell.focus) >= bell.width:
            return None
        return found if x.min() < found.focus < x.max() else None

    def _is_behind(self, bell: Bell, lens: list[float], *, x: np.ndarray, y: np.ndarray) -> bool:
        """Return whether the lens has passed the top of a bell, and had come from its other side."""
        margin = (self.beyond + self.doubt * bell.misfit) * bell.width
        way = np.sign(lens[-1] - bell.focus)
        before = max(way * (bell.focus - position) for position in lens)
        began_near = before > 0 and abs(lens[0] - bell.focus) < margin and bell.misfit < self.rough / 4
        return bool(
            way * (x[-1] - bell.focus) > margin and (before > margin or began_near) and y.min() < self.low * y.max()
        )


def contrast_of_blocks(counts: np.ndarray) -> float:
    """Return the standard deviation of the mean counts of BLOCKS × BLOCKS parts of a picture over their mean, or 0."""
    rows, columns = (np.array_split(np.arange(size), min(BLOCKS, size)) for size in counts.shape)
    means = np.array([[counts[r[0] : r[-1] + 1, c[0] : c[-1] + 1].mean() for c in columns] for r in rows])
    return float(means.std() / means.mean()) if means.any() else 0.0


def estimate_dark_rate(rate: np.ndarray, contrast: np.ndarray) -> float:
    """Return how many spikes of the dark there are in ``rate`` (n,), spikes per pixel and frame of n windows.

    ``contrast`` (n,) is that of the same windows, which the dark lowers to c·(1 − dark/rate): a line over 1/rate,
    fitted by least squares. 0 where light changes by less than LIGHT_RATIO, or contrast does not fall with it; at most
    MOST_DARK of the least rate.
    """
    if rate.max() < LIGHT_RATIO * rate.min():
        return 0.0
    slope, level = np.polyfit(1 / rate, contrast, 1)
    return float(np.clip(-slope / level, 0, MOST_DARK * rate.min())) if level > 0 else 0.0


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
