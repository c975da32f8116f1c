"""Texture from intervals (TFI): the brightness of each pixel from the time between two spikes.

Counts of a window average over all of it; the interval round its middle is short, so that little moves
meanwhile, and coarse, because it is a whole number of readouts.
"""

from collections.abc import Callable

import numpy as np
from numba import njit

from saf_gen.benchmark.view.stopwatch import Stopwatch

__all__ = ["texture_from_intervals", "time_texture_from_intervals"]

FIRST_BYTES = 8
"""Bytes along time that are looked at on a side to begin with; each further look takes twice as many."""
OPEN = -1
"""Stands for a spike that is not found yet."""


@njit(nogil=True, cache=True)
def _look_back(packed, base, first, stop, found):
    """Set ``found`` where it is OPEN to the last spike in frames first <= t < stop; how many stay open."""
    still_open = 0
    for y in range(packed.shape[0]):
        for x in range(packed.shape[1]):
            for b in range(packed.shape[2] - 1, -1, -1):
                if found[y, x] >= 0:
                    break
                byte = packed[y, x, b]
                if byte:
                    for k in range(7, -1, -1):
                        t = 8 * (base + b) + k
                        if byte >> k & 1 and first <= t < stop:
                            found[y, x] = t
                            break
            still_open += found[y, x] < 0
    return still_open


@njit(nogil=True, cache=True)
def _look_ahead(packed, base, first, stop, found):
    """As _look_back, for the first spike."""
    still_open = 0
    for y in range(packed.shape[0]):
        for x in range(packed.shape[1]):
            for b in range(packed.shape[2]):
                if found[y, x] >= 0:
                    break
                byte = packed[y, x, b]
                if byte:
                    for k in range(8):
                        t = 8 * (base + b) + k
                        if byte >> k & 1 and first <= t < stop:
                            found[y, x] = t
                            break
            still_open += found[y, x] < 0
    return still_open


def texture_from_intervals(
    read: Callable[[int, int], np.ndarray], count: Callable[[int, int], np.ndarray], first: int, *, stop: int
) -> np.ndarray:
    """Texture from intervals of the n frames ``first <= t < stop``: float64 (h, w), in counts.

    A pixel gets n over the interval from its last spike at or before the middle frame, (first + stop − 1)//2,
    to its next one: what it would count in the window at that rate, so that the unit is that of counts. Where
    either spike is not in the window it gets 0.0. Range 0 ... n.

    ``read(first_byte, stop_byte)`` gives time-packed spikes uint8 (h, w, bytes), any memory layout: frame t
    is bit t mod 8, least significant first, of byte t div 8. It is asked from the middle outwards, until
    every pixel has its spikes. ``count(first, stop)`` gives counts (h, w); it tells which pixels have any.
    Source: Zhu et al., A Retina-inspired Sampling Method for Visual Texture Reconstruction, ICME 2019,
    doi:10.1109/ICME.2019.00248.
    """
    after_middle = (first + stop - 1) // 2 + 1
    has_before = count(first, after_middle) > 0
    has_after = count(after_middle, stop) > 0 if after_middle < stop else np.zeros_like(has_before)
    known = has_before & has_after
    before = np.where(known, OPEN, 0)
    after = before.copy()
    still_open, end, size = known.any(), (after_middle - 1) // 8 + 1, FIRST_BYTES
    while still_open:
        begin = max(end - size, first // 8)
        still_open = _look_back(read(begin, end), begin, first, after_middle, before)
        end, size = begin, 2 * size
    still_open, begin, size = known.any(), after_middle // 8, FIRST_BYTES
    while still_open:
        end = min(begin + size, (stop - 1) // 8 + 1)
        still_open = _look_ahead(read(begin, end), begin, after_middle, stop, after)
        begin, size = end, 2 * size
    return np.divide(stop - first, after - before, out=np.zeros(known.shape), where=known)


def time_texture_from_intervals(
    read: Callable[[int, int], np.ndarray], count: Callable[[int, int], np.ndarray], first: int, *, stop: int
) -> tuple[np.ndarray, float]:
    """The same, and the seconds that it took without those of ``read`` and ``count``.

    Where loops had to be compiled or loaded for it, it is made once more: that is done once a machine.
    """
    known = _compiled()
    whole, camera = Stopwatch(), Stopwatch()
    image = whole.time(
        texture_from_intervals,
        lambda first_byte, stop_byte: camera.time(read, first_byte, stop_byte),
        lambda begin, end: camera.time(count, begin, end),
        first,
        stop=stop,
    )
    if _compiled() > known:
        return time_texture_from_intervals(read, count, first, stop=stop)
    return image, whole.seconds - camera.seconds


def _compiled() -> int:
    return sum(len(loop.signatures) for loop in (_look_back, _look_ahead))
