"""The exact integral of straight lines through points, for schedules that are made of them."""

import numpy as np


def integrate_piecewise_linear_gain(seconds: np.ndarray, *, times: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """Return the integral from 0 to each time of the line through (``times``, ``gains``).

    ``times`` (N,) rise, with N at least 1; beyond both ends the line is level. The result is exact.
    """
    seconds = np.asarray(seconds, dtype=np.float64)
    return (
        _antiderivative(seconds, times=times, gains=gains) - _antiderivative(np.zeros(1), times=times, gains=gains)[0]
    )


def _antiderivative(seconds: np.ndarray, *, times: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """Return the integral from the first point to each time."""
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
