"""Quality of a focus curve, whatever searches it: the criteria of autofocus microscopy, on a sweep.

The criteria are accuracy, range, false maxima, width and noise. A curve is shifted and scaled to 0–1 first,
so that measures of any unit compare. Spike counts are noisy: where the papers take every rise,
MIN_PROMINENCE says how large one must be to end a climb; ``false_maxima`` counts them all.

References: Groen, Young and Ligthart, Cytometry 6(2), 1985, doi:10.1002/cyto.990060202; Santos et al.,
J. Microscopy 188(3), 1997, doi:10.1046/j.1365-2818.1997.2630819.x; Sun, Duthaler and Nelson, Microscopy
Research and Technique 65(3), 2004, doi:10.1002/jemt.20118.
"""

from dataclasses import dataclass

import numpy as np

MIN_PROMINENCE = 0.1
"""Fraction of the curve's height; a smaller rise does not end the range and makes no false peak."""
MIN_NOISE_SAMPLES = 8
"""Fewest second differences for an estimate of the noise."""


@dataclass(frozen=True, slots=True)
class CurveQuality:
    """Criteria of one curve; positions and widths are fractions of the travel, None means unknown."""

    peak: float
    """Lens position at which the curve is largest."""
    accuracy: float | None
    """Distance of the peak from the truth."""
    accuracy_dof: float | None
    """Distance of the peak from the truth in depths of focus."""
    range: float
    """Distance between the minima beside the peak; on a side that never rises again by MIN_PROMINENCE, the
    end of the sweep counts."""
    false_maxima: int
    """Local maxima beside the peak, however small; an end of the sweep may be one."""
    false_peaks: int
    """Local maxima beside the peak whose prominence is above MIN_PROMINENCE."""
    width_50: float | None
    """Width at half the height; None where a side never falls so far."""
    width_80: float | None
    """Width at 80 % of the height; None where a side never falls so far."""
    noise: float | None
    """Standard deviation of the white noise on the curve, as a fraction of its height."""


@dataclass(frozen=True, slots=True)
class AssessedCurve:
    """The quality of one measure's curve on one sequence; None means unknown.

    ``truth`` and ``depth_of_focus`` are fractions of the travel. A curve that is constant, or over a lens that comes
    back or rests, has no ``quality``.
    """

    measure: str
    sequence: str
    split: str | None
    scene: str
    light: str | None
    truth: float | None
    depth_of_focus: float | None
    quality: CurveQuality | None


def assess_evaluated_curve(
    position: np.ndarray, scores: np.ndarray, *, truth: float | None = None, depth: float | None = None
) -> CurveQuality | None:
    """Return the quality of a focus curve: scores (B,) over the lens positions (B,) of their blocks.

    Positions, the best focus ``truth`` and the depth of focus ``depth`` are fractions of the travel; scores have any
    unit. None where there is no curve: fewer than three blocks, constant scores, or a lens that comes back or rests.
    """
    from scipy.signal import find_peaks  # loaded in half a second, which commands that judge no curve do without

    x, y = np.asarray(position, dtype=np.float64), np.asarray(scores, dtype=np.float64)
    steps = np.diff(x)
    if y.size < 3 or not (np.all(steps > 0) or np.all(steps < 0)) or not y.max() > y.min():
        return None
    top = int(y.argmax())
    if steps[0] < 0:
        x, y, top = x[::-1], y[::-1], y.size - 1 - top
    y = (y - y.min()) / (y.max() - y.min())
    accuracy = None if truth is None else abs(float(x[top]) - truth)
    # With a zero on either side, an end of the curve can be a maximum, and its base is the curve's lowest point.
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
    """Index of the lowest point on one side of the peak before the curve rises again, or of the end.

    scipy.signal has no such minimum: its bases are those of the prominence, beyond every smaller peak.
    """
    side = y[top:] if step > 0 else y[top::-1]
    risen = np.flatnonzero(side - np.minimum.accumulate(side) > MIN_PROMINENCE)
    return top + step * (int(side[: risen[0]].argmin()) if risen.size else side.size - 1)


def _width(x: np.ndarray, y: np.ndarray, *, top: int, level: float) -> float | None:
    """Distance between the crossings of ``level`` nearest to the peak, on straight lines between blocks.

    scipy.signal.peak_widths counts in samples, whose spacing differs here, and takes the end of the signal
    for a crossing that is not there.
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
    """Noise from second differences below half the height, away from the bend of the peak.

    White noise of variance σ² gives them the variance 6σ²; a smooth curve gives them next to nothing.
    """
    low = y < 0.5
    bends = np.diff(y, 2)[low[:-2] & low[1:-1] & low[2:]]
    return float(np.sqrt(np.mean(bends**2) / 6)) if bends.size >= MIN_NOISE_SAMPLES else None
