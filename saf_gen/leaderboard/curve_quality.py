"""How good a focus curve is, whatever searches it: the criteria of microscopy, on a sweep.

After Groen, Young and Ligthart, Cytometry 6(2), 1985, doi:10.1002/cyto.990060202; Santos et al.,
J. Microscopy 188(3), 1997, doi:10.1046/j.1365-2818.1997.2630819.x; and Sun, Duthaler and Nelson, Microscopy
Research and Technique 65(3), 2004, doi:10.1002/jemt.20118: accuracy, range, false maxima, width, noise. A
curve is moved and scaled to 0...1 first, so that measures of any unit compare. Spike counts are noisy: where
those papers take every rise, MIN_PROMINENCE says how large one must be to end a climb; ``false_maxima`` has
them all.
"""

from dataclasses import dataclass

import numpy as np

__all__ = ["MIN_PROMINENCE", "CurveQuality", "assess_focus_curve"]

MIN_PROMINENCE = 0.1
"""Of the curve's height: a smaller rise does not end the range and makes no false peak."""
MIN_NOISE_SAMPLES = 8
"""Second differences that an estimate of noise needs."""


@dataclass(frozen=True)
class CurveQuality:
    """Places and widths as fractions of the travel. None is unknown."""

    peak: float
    """Where the curve is largest."""
    accuracy: float | None
    """Distance of the peak from the truth."""
    accuracy_dof: float | None
    """The same in depths of focus."""
    range: float
    """Between the minima beside the peak, or the ends of the sweep where it never rises again by
    MIN_PROMINENCE."""
    false_maxima: int
    """Local maxima beside the peak, however small; an end of the sweep may be one."""
    false_peaks: int
    """Those whose prominence is above MIN_PROMINENCE."""
    width_50: float | None
    """Width at half the height; None where a side never falls so far."""
    width_80: float | None
    """Width at 80 % of the height."""
    noise: float | None
    """Standard deviation of what white noise is on the curve, of its height."""


def assess_focus_curve(
    position: np.ndarray, scores: np.ndarray, *, truth: float | None = None, depth: float | None = None
) -> CurveQuality | None:
    """The quality of the curve ``scores`` (B,) over ``position`` (B,), the lens at the blocks' centres.

    ``truth`` is the best focus, ``depth`` the depth of focus, all in fractions of the travel. None where
    there is no curve: fewer than three blocks, a flat one, or a lens that comes back or rests.
    """
    x, y = np.asarray(position, dtype=np.float64), np.asarray(scores, dtype=np.float64)
    steps = np.diff(x)
    if y.size < 3 or not (np.all(steps > 0) or np.all(steps < 0)) or not y.max() > y.min():
        return None
    top = int(y.argmax())
    if steps[0] < 0:
        x, y, top = x[::-1], y[::-1], y.size - 1 - top
    y = (y - y.min()) / (y.max() - y.min())
    away = None if truth is None else abs(float(x[top]) - truth)
    maxima = _maxima(y)
    return CurveQuality(
        peak=float(x[top]),
        accuracy=away,
        accuracy_dof=None if away is None or not depth else away / depth,
        range=float(x[_foot(y, top, 1)] - x[_foot(y, top, -1)]),
        false_maxima=len(maxima) - 1,
        false_peaks=sum(_prominence(y, i) > MIN_PROMINENCE for i in maxima) - 1,
        width_50=_width(x, y, top, 0.5),
        width_80=_width(x, y, top, 0.8),
        noise=_noise(y),
    )


def _maxima(y: np.ndarray) -> list[int]:
    """Where the curve is higher than on either side; a plateau is there once, an end has one side."""
    starts = np.concatenate(([0], np.flatnonzero(np.diff(y)) + 1))
    heights = np.concatenate(([-np.inf], y[starts], [-np.inf]))
    higher = (heights[1:-1] > heights[:-2]) & (heights[1:-1] > heights[2:])
    return [int(i) for i in starts[higher]]


def _prominence(y: np.ndarray, at: int) -> float:
    """How far down the way to a higher place goes; of the highest, its whole height."""
    bases = []
    for side in (y[at::-1], y[at:]):
        higher = np.flatnonzero(side > y[at])
        bases.append(float(side[: higher[0]].min()) if higher.size else 0.0)
    return float(y[at]) - max(bases)


def _foot(y: np.ndarray, top: int, way: int) -> int:
    """The lowest place on one side of the peak before the curve rises again; the end where it does not."""
    side = y[top:] if way > 0 else y[top::-1]
    risen = np.flatnonzero(side - np.minimum.accumulate(side) > MIN_PROMINENCE)
    return top + way * (int(side[: risen[0]].argmin()) if risen.size else side.size - 1)


def _width(x: np.ndarray, y: np.ndarray, top: int, level: float) -> float | None:
    """Distance of the crossings of ``level`` nearest to the peak, on straight lines between blocks."""
    ends = []
    for places, side in ((x[top::-1], y[top::-1]), (x[top:], y[top:])):
        below = np.flatnonzero(side <= level)
        if not below.size:
            return None
        i = int(below[0])
        ends.append(np.interp(level, [side[i], side[i - 1]], [places[i], places[i - 1]]))
    return float(ends[1] - ends[0])


def _noise(y: np.ndarray) -> float | None:
    """From second differences below half the height, away from the bend of the peak.

    White noise of variance σ² gives them 6σ²; a smooth curve gives them next to nothing.
    """
    low = y < 0.5
    flat = low[:-2] & low[1:-1] & low[2:]
    bends = np.diff(y, 2)[flat]
    return float(np.sqrt(np.mean(bends**2) / 6)) if bends.size >= MIN_NOISE_SAMPLES else None
