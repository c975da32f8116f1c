"""Bell fitted to the focus curve: while the lens moves, it locates a focus in or just outside the sweep."""

from dataclasses import dataclass
from math import isfinite
from typing import ClassVar, NamedTuple

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._light_windows import equal_light_windows
from saf_gen.plugins.searches._score_curve import ScoreCurve
from saf_gen.plugins.searches._windows import check_frame_count, check_numbers

BROAD, FINEST = "sd_calibrated", "vollath_f4_n"
LEAST_SCORES = 8
"""Smallest number of scores for a bell: noise alone very rarely puts that many neighbouring scores on a bell."""
SMOOTH, UNTIL, LEAST, FALL = 2.0, 0.5, 0.2, 0.03
"""Options ``smooth``, ``until``, ``least`` and ``fall`` of photon_aware, used for a curve that is not a bell."""
FINEST_WITHIN = 1.5
"""Distance from the focus, in half widths of the bell, within which the finest differences are scored."""
BLOCKS, LIGHT_RATIO, MOST_DARK = 4, 1.3, 0.9
"""Blocks of a picture along each axis; smallest ratio of the highest to the lowest rate from which a dark rate is
estimated; largest dark rate as a fraction of the lowest rate."""


class Bell(NamedTuple):
    """A curve of height/(1 + ((x − focus)/width)²) over lens positions x."""

    focus: float
    width: float
    misfit: float
    """Root mean square of the relative residuals, per degree of freedom; residuals near the top weigh more."""


@dataclass(frozen=True)
class PeakFit:
    """Fits a bell to the focus curve while the lens moves, and stops as soon as the lens has passed its top.

    The blur of a flat target is linear in the position x of the lens, and the energy of the gradients of a texture with
    the spectrum of natural scenes (1/f²) falls with the square of a large blur. Near the focus, the curve is therefore
    a bell, y = a/(1 + ((x − x₀)/w)²), and 1/y is a parabola. Linear least squares give the focus x₀ and the half width
    w, even from one side of the bell.

    Windows have equal light: after each of ``steps`` steps of a recording, the window that ends there is the shortest
    one with ``counts`` spikes per pixel, but no longer than the fraction ``longest`` of the recording. Its score
    belongs to the mean position of the lens during the window. The fit uses the scores around the largest, in order of
    position, as far as they stay above ``above`` times the largest. Its weights assume scores with equal errors, and
    are larger for windows with more spikes.

    Dark spikes reduce contrast, more so in less light, so a change of the light changes the curve even if the focus
    stays the same. Therefore, the search estimates the dark rate d from the contrast c of coarse blocks of the picture,
    which changes little with focus and which dark spikes lower to c·(1 − d/rate). The fit uses the score divided by
    (1 − d/rate)². If ``dark`` is false, it uses the score itself, as is right for a calibrated measure.

    A bell is accepted if its misfit, the relative residual, is below ``rough``. The search stops if three windows in a
    row are past the top by more than the margin (``beyond`` + ``doubt``·misfit)·w, and some score is below ``low``
    times the largest. In addition, the lens must have been in front of the top by more than the margin, or, if the
    sweep began within the margin, the misfit must be below a quarter of ``rough``. While no bell is accepted, the
    search stops where ``photon_aware`` would, because a curve need not be a bell.

    Then the top is fitted once more with ``vollath_f4_n``, a measure of the finest differences, which other depths of
    the target affect less. This fit uses its scores within 1.5·w of x₀ that stay above ``near`` times the largest. If
    they form a bell with a top within w of x₀ and within the positions that the lens passed, its x₀ replaces the first
    one. If ``near`` is 0, this fit is left out.

    The answer is the frame at which the lens was nearest to x₀. The focus x₀ may be up to ``reach``·w outside the
    positions that the lens passed: on most scenes w is 1.2 to 2.2 depths of focus for ``structure_calibrated`` and 1.9
    to 3.8 for ``octave_structure``, so that the end of the sweep is about in focus. Without a bell, the search answers
    like ``photon_aware``, which abstains if the curve does not fall on both sides. If lens positions are not recorded,
    frames are used in their place.

    Choose a measure that has no floor of noise; ``octave_structure`` needs no calibration either. Each step takes three
    scores, one of them with the method's measure, and reads the counts of a window; some scores of the finest
    differences follow at the end. The trace holds the frame of the focus found so far, whenever it changes.

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
        check_frame_count("steps", self.steps)
        fractions = dict.fromkeys(("longest", "above", "low", "rough", "near"), 1.0)
        check_numbers(self, {"counts": 1e6, "beyond": 10, "doubt": 1e3, "reach": 10, **fractions})
        if not isinstance(self.dark, bool):
            raise BadInput(f"dark is {self.dark!r}", allowed="true, false")

    def __call__(self, view: View) -> Answer:
        """Return the answer for a sweep; raise BadInput if it has fewer than two frames per step."""
        step = view.frames // self.steps
        lens: list[float] = []  # lens position in the middle of each step so far
        windows: list[tuple[int, int]] = []
        rows: list[tuple[float, ...]] = []  # per window: lens position, score, spikes per pixel, contrast of blocks
        curve, broad = (ScoreCurve(SMOOTH * step, self.steps) for _ in range(2))
        trace: list[float] = []
        bell, passed, fallen = None, 0, 0
        for first, stop, light, steps in equal_light_windows(view, self.counts, steps=self.steps, longest=self.longest):
            while len(lens) < stop // step:
                lens.append(_lens_position(view, len(lens) * step + step // 2))
            middle, score = (first + stop) / 2 - 0.5, view.score(first, stop)
            windows.append((first, stop))
            contrast = block_contrast(view.counts(first, stop)) if self.dark else 0.0
            rows.append((float(np.mean(lens[first // step :])), score, light, contrast))
            curve.add(middle, score)
            broad.add(middle, view.score(first, stop, BROAD))
            x, y, spikes, contrasts = np.array(rows).T
            rate = spikes / np.array([b - a for a, b in windows])
            undimmed = (1 - dark_rate_of(rate, contrasts) / rate) ** 2
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
        """Return the bell fitted to the scores of ``FINEST`` near the top of ``bell``, or None if they form no bell."""
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
        """Return whether the lens has clearly passed the top of a bell, coming from the other side."""
        margin = (self.beyond + self.doubt * bell.misfit) * bell.width
        way = np.sign(lens[-1] - bell.focus)
        before = max(way * (bell.focus - position) for position in lens)
        began_near = before > 0 and abs(lens[0] - bell.focus) < margin and bell.misfit < self.rough / 4
        return bool(
            way * (x[-1] - bell.focus) > margin and (before > margin or began_near) and y.min() < self.low * y.max()
        )


def block_contrast(counts: np.ndarray) -> float:
    """Return the rms deviation of the means of BLOCKS × BLOCKS parts of a picture, divided by the mean; 0 if dark."""
    rows, columns = (np.array_split(np.arange(size), min(BLOCKS, size)) for size in counts.shape)
    means = np.array([[counts[r[0] : r[-1] + 1, c[0] : c[-1] + 1].mean() for c in columns] for r in rows])
    return float(means.std() / means.mean()) if means.any() else 0.0


def dark_rate_of(rate: np.ndarray, contrast: np.ndarray) -> float:
    """Return the rate of dark spikes in n windows, in spikes per pixel and frame.

    ``rate`` (n,) holds the spikes per pixel and frame of the windows, and ``contrast`` (n,) their contrast. Dark spikes
    lower the contrast to c·(1 − dark/rate), which is fitted by least squares as a line in 1/rate. The result is 0 if
    the light changes by less than the factor LIGHT_RATIO, or if contrast does not fall with the light. It is at most
    MOST_DARK of the lowest rate.
    """
    if rate.max() < LIGHT_RATIO * rate.min():
        return 0.0
    slope, level = np.polyfit(1 / rate, contrast, 1)
    return float(np.clip(-slope / level, 0, MOST_DARK * rate.min())) if level > 0 else 0.0


def fit_bell(x: np.ndarray, y: np.ndarray, *, light: np.ndarray, above: float) -> Bell | None:
    """Return the bell through scores y at lens positions x, or None if they do not form one.

    ``x``, ``y`` and ``light``, the spikes per pixel of the windows, are (n,). The fit uses the scores around the
    largest, in order of position, as far as they stay above the fraction ``above`` of it.
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
    weights = y * y * np.sqrt(light / light.max())  # the error of 1/y is the error of y over y²
    (bend, slope, level), _, rank, _ = np.linalg.lstsq(powers * weights[:, None], weights / y, rcond=1e-6)
    if rank < 3 or bend <= 0 or (least := level - slope * slope / (4 * bend)) <= 0:
        return None  # the lens rested, or 1/y is not a parabola with a minimum above zero
    residuals = powers @ (bend, slope, level) * y - 1
    misfit = np.sqrt(np.average(residuals**2, weights=weights) * len(x) / (len(x) - 3))
    return Bell(float(centre - scale * slope / (2 * bend)), float(scale * np.sqrt(least / bend)), float(misfit))


def frame_nearest(position: float, lens: list[float], *, step: int) -> float:
    """Return the frame at which the lens was nearest to ``position``.

    ``lens`` holds the lens position in the middle of each step of ``step`` frames.
    """
    x = np.asarray(lens)
    k = int(np.abs(x - position).argmin())
    middle = k * step + (step - 1) / 2
    for other in (k - 1, k + 1):
        if 0 <= other < len(x) and (x[other] - position) * (x[k] - position) < 0:
            return float(middle + (other - k) * step * (position - x[k]) / (x[other] - x[k]))
    return float(middle)


def _lens_position(view: View, frame: int) -> float:
    """Return the lens position at a frame, or the frame as a fraction of all frames if the position is unknown."""
    position = view.position(frame)
    return position if isfinite(position) else frame / view.frames
