"""The exact integral of a gain that is interpolated linearly between points."""

import numpy as np


def integrate_gain(seconds: np.ndarray, *, times: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """Return the exact integral, from 0 to each of ``seconds``, of a gain interpolated linearly between points.

    ``times`` (N,) and ``gains`` (N,) are the points; times increase, and N is at least 1. Before the first point and
    after the last one, the gain is constant.
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
    cumulative = np.concatenate(([0.0], np.cumsum(steps * (gains[:-1] + gains[1:]) / 2)))
    within = np.clip(seconds, first, last)
    i = np.clip(np.searchsorted(times, within, side="right") - 1, 0, len(steps) - 1)
    elapsed = within - times[i]
    return level + cumulative[i] + elapsed * (gains[i] + 0.5 * slopes[i] * elapsed)
