"""Quality of a focus curve of a sweep by the criteria of autofocus microscopy, independent of any search.

The criteria are accuracy, range, false maxima, width and noise. A curve is first shifted and scaled to 0–1, so that
measures with different units can be compared. The papers count every rise of the curve. Spike counts are noisy, so here
only rises above MIN_PROMINENCE count, except in ``false_maxima``, which counts all of them.

References
----------
Groen, Young and Ligthart, Cytometry 6(2), 1985, doi:10.1002/cyto.990060202.
Santos et al., J. Microscopy 188(3), 1997, doi:10.1046/j.1365-2818.1997.2630819.x.
Sun, Duthaler and Nelson, Microscopy Research and Technique 65(3), 2004, doi:10.1002/jemt.20118.
"""

from dataclasses import dataclass

import numpy as np

MIN_PROMINENCE = 0.1
"""Fraction of the curve's height that a rise must exceed to end the range or to count as a false peak."""
MIN_NOISE_SAMPLES = 8
"""Minimum number of second differences from which the noise is estimated."""


@dataclass(frozen=True, slots=True)
class CurveQuality:
    """Criteria of one focus curve; positions and widths are fractions of the travel, and None means unknown."""

    peak: float
    """Lens position at which the curve is largest."""
    accuracy: float | None
    """Distance of the peak from the truth."""
    accuracy_dof: float | None
    """Distance of the peak from the truth, in depths of focus."""
    range: float
    """Distance between the minima on both sides of the peak. On a side where the curve does not rise again by more than
    MIN_PROMINENCE, the end of the sweep is used instead."""
    false_maxima: int
    """Number of local maxima other than the peak, however small; an end of the sweep may be one."""
    false_peaks: int
    """Number of local maxima other than the peak whose prominence is above MIN_PROMINENCE."""
    width_50: float | None
    """Width of the peak at half its height; None if the curve does not fall that far on both sides."""
    width_80: float | None
    """Width of the peak at 80 % of its height; None if the curve does not fall that far on both sides."""
    noise: float | None
    """Standard deviation of the white noise on the curve, as a fraction of its height."""


@dataclass(frozen=True, slots=True)
class AssessedCurve:
    """The quality of one measure's focus curve on one sequence; None means unknown.

    ``truth`` and ``depth_of_focus`` are fractions of the travel. ``quality`` is also None if the curve is constant or
    has fewer than three blocks, or if the lens turned back or rested.
    """

    measure: str
    sequence: str
    split: str | None
    scene: str
    light: str | None
    truth: float | None
    depth_of_focus: float | None
    quality: CurveQuality | None


def assess_curve(
    position: np.ndarray, scores: np.ndarray, *, truth: float | None = None, depth: float | None = None
) -> CurveQuality | None:
    """Return the quality of a focus curve.

    Parameters
    ----------
    position : ndarray of float, shape (B,)
        Lens position of each block, as fractions of the travel.
    scores : ndarray of float, shape (B,)
        Score of each block, in any unit.
    truth : float, optional
        Best focus, as a fraction of the travel.
    depth : float, optional
        Depth of focus, as a fraction of the travel.

    Returns
    -------
    CurveQuality or None
        None if there are fewer than three blocks, if the scores are constant, or if the lens turned back or rested.
    """
    from scipy.signal import find_peaks  # imported late: it takes half a second, and few commands need it

    x, y = np.asarray(position, dtype=np.float64), np.asarray(scores, dtype=np.float64)
    steps = np.diff(x)
    if y.size < 3 or not (np.all(steps > 0) or np.all(steps < 0)) or not y.max() > y.min():
        return None
    top = int(y.argmax())
    if steps[0] < 0:
        x, y, top = x[::-1], y[::-1], y.size - 1 - top
    y = (y - y.min()) / (y.max() - y.min())
    accuracy = None if truth is None else abs(float(x[top]) - truth)
    # Zeros on both sides allow an end of the curve to be a maximum whose base is the lowest point of the curve.
    maxima, properties = find_peaks(np.pad(y, 1), prominence=0)
    return CurveQuality(
        peak=float(x[top]),
        accuracy=accuracy,
        accuracy_dof=None if accuracy is None or not depth else accuracy / depth,
        range=float(x[_foot(y, top, step=1)] - x[_foot(y, top, step=-1)]),
        false_maxima=len(maxima) - 1,
        false_peaks=int(np.sum(properties["prominences"] > MIN_PROMINENCE)) - 1,
        width_50=_width(x, y, top=top, level=0.5),
        width_80=_width(x, y, top=top, level=0.8),
        noise=_estimate_noise(y),
    )


def _foot(y: np.ndarray, top: int, *, step: int) -> int:
    """Return the index of the lowest point between the peak and the next rise on one side; the end if it never rises.

    ``scipy.signal`` does not offer this minimum: the bases of its prominences are beyond every smaller peak.
    """
    side = y[top:] if step > 0 else y[top::-1]
    risen = np.flatnonzero(side - np.minimum.accumulate(side) > MIN_PROMINENCE)
    return top + step * (int(side[: risen[0]].argmin()) if risen.size else side.size - 1)


def _width(x: np.ndarray, y: np.ndarray, *, top: int, level: float) -> float | None:
    """Return the distance between the crossings of ``level`` nearest to the peak, or None if one is missing.

    The curve is interpolated linearly between blocks. ``scipy.signal.peak_widths`` does not fit here: it measures in
    samples, whose spacing varies, and uses the end of the signal in place of a missing crossing.
    """
    ends = []
    for positions, side in ((x[top::-1], y[top::-1]), (x[top:], y[top:])):
        below = np.flatnonzero(side <= level)
        if not below.size:
            return None
        i = int(below[0])
        ends.append(np.interp(level, [side[i], side[i - 1]], [positions[i], positions[i - 1]]))
    return float(ends[1] - ends[0])


def _estimate_noise(y: np.ndarray) -> float | None:
    """Return the noise of a curve from its second differences below half the height, where the peak does not bend it.

    White noise of variance σ² gives second differences of variance 6σ²; a smooth curve adds almost nothing to them.
    """
    low = y < 0.5
    bends = np.diff(y, 2)[low[:-2] & low[1:-1] & low[2:]]
    return float(np.sqrt(np.mean(bends**2) / 6)) if bends.size >= MIN_NOISE_SAMPLES else None
