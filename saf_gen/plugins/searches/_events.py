"""Events of two consecutive windows: what an event camera would have sent between them."""

import numpy as np


def count_events(before: np.ndarray, after: np.ndarray, *, contrast: float) -> np.ndarray:
    """Return the events of each pixel between two windows of equal length: above 0 if it became brighter.

    An event camera sends an event each time log intensity has changed by the threshold ``contrast``. A spike camera
    has counts, so the number of events is ln((after + ½)/(before + ½))/contrast, rounded towards 0. Half a spike,
    added to both counts, keeps the logarithm finite. ``before``, ``after`` and the result, float64, are (row, col).
    """
    return np.trunc((np.log(after + 0.5) - np.log(before + 0.5)) / contrast)
