"""Texture from intervals (TFI): the brightness of each pixel from the time between two spikes.

The counts of a window average over its whole duration. The interval around its middle is short, so that little moves
in it, but coarse, because it is a whole number of readouts.
"""

from collections.abc import Callable

import numpy as np
from numba import njit

from saf_gen.core.stopwatch import Stopwatch

Read = Callable[[int, int], np.ndarray]

FIRST_BYTES = 8
"""Bytes along time that are read first on each side of the middle; each further read covers twice as many."""
OPEN = -1
"""Marks a pixel whose spike has not been found yet."""


@njit(nogil=True, cache=True)
def _look_back(packed, base, first, stop, found):
    """Set each OPEN pixel of ``found`` to its last spike in first <= t < stop; return how many pixels stay open."""
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
    """Set each OPEN pixel of ``found`` to its first spike in first <= t < stop; return how many pixels stay open."""
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


def window_texture(read: Read, count: Read, *, first: int, stop: int) -> np.ndarray:
    """Return the texture from intervals of the n frames ``first <= t < stop``.

    The value of a pixel is n divided by the interval from its last spike at or before the middle frame,
    (first + stop − 1)//2, to its next spike. This is the number of spikes in the window at that rate, so that the
    values have the unit of counts.

    Parameters
    ----------
    read : callable
        ``read(first_byte, stop_byte)`` returns packed spikes, uint8 (h, w, bytes) in any memory layout: frame t is
        bit t mod 8, least significant first, of byte t div 8. It is called from the middle outwards until every pixel
        has its spikes.
    count : callable
        ``count(first, stop)`` returns counts (h, w), which show whether a pixel has any spike.
    first, stop : int
        The window, in frames from 0.

    Returns
    -------
    ndarray of float64, shape (h, w)
        Values from 0 to n; 0.0 if either spike is not in the window.

    References
    ----------
    Zhu et al., A Retina-inspired Sampling Method for Visual Texture Reconstruction, ICME 2019,
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


def window_time_texture(read: Read, count: Read, *, first: int, stop: int) -> tuple[np.ndarray, float]:
    """Return the texture from intervals and the seconds that it took, not counting calls of ``read`` and ``count``.

    If a loop had to be compiled or loaded, the texture is computed once more, so that compilation is not counted. See
    :func:`window_texture` for the parameters.
    """
    compiled = _count_compiled_loops()
    total, camera = Stopwatch(), Stopwatch()
    image = total.time(
        window_texture,
        lambda first_byte, stop_byte: camera.time(read, first_byte, stop_byte),
        lambda begin, end: camera.time(count, begin, end),
        first=first,
        stop=stop,
    )
    if _count_compiled_loops() > compiled:
        return window_time_texture(read, count, first=first, stop=stop)
    return image, total.seconds - camera.seconds


def _count_compiled_loops() -> int:
    return sum(len(loop.signatures) for loop in (_look_back, _look_ahead))
