"""What schedules of straight lines share: the exact integral of a line through points."""

import numpy as np


def integrate_piecewise_linear(seconds: np.ndarray, times: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """Integral from 0 to each time of the line through (``times``, ``gains``), level beyond both ends.

    ``times`` (N,) rise, N at least 1. Exact: trapezia whole, the one begun as a parabola.
    """
    seconds = np.asarray(seconds, dtype=np.float64)
    return _primitive(seconds, times, gains) - _primitive(np.zeros(1), times, gains)[0]


def _primitive(seconds: np.ndarray, times: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """An integral that is 0 at the first point."""
    first, last = times[0], times[-1]
    level = gains[0] * np.minimum(seconds - first, 0) + gains[-1] * np.maximum(seconds - last, 0)
    if len(times) == 1:
        return level
    steps = np.diff(times)
    slopes = np.diff(gains) / steps
    whole = np.concatenate(([0.0], np.cumsum(steps * (gains[:-1] + gains[1:]) / 2)))
    within = np.clip(seconds, first, last)
    i = np.clip(np.searchsorted(times, within, side="right") - 1, 0, len(steps) - 1)
    since = within - times[i]
    return level + whole[i] + since * (gains[i] + 0.5 * slopes[i] * since)
