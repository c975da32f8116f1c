"""The encoder's inner loop, compiled: 64 pixels at a time, readout after readout, bits packed along time.

Every operation is one IEEE float32 or uint32 operation in a fixed order and nothing is fused or reordered
(no fastmath), so the bits are the same on every machine. The loops over the 64 lanes hold no branch, and
all lane state lies in one array a dtype, which is what lets the compiler prove that they vectorise.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

__all__ = ["LANES", "NOISE_MEAN", "NOISE_SD", "advance"]

LANES = 64

# The noise of a threshold is the sum of the four bytes of a uniform 32-bit word (Irwin–Hall of order 4 on
# a grid): mean and variance are exact, skewness 0, excess kurtosis -0.3, support ±3.45 sd.
NOISE_MEAN = 510.0
NOISE_SD = (4 * (256**2 - 1) / 12) ** 0.5

_ACCUMULATED, _THRESHOLD, _SHARE, _DARK, _BASE, _SLOPE, _CAP, _CHARGE = range(0, 8 * LANES, LANES)


def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    try:
        return njit(nogil=True, cache=True)(function)
    except RuntimeError:  # numba found no folder it may write a cache to: a read-only install
        return njit(nogil=True)(function)


@_compiled
def advance(
    first,
    stop,
    stack,
    index,
    low_weight,
    high_weight,
    words,
    response,
    fixed,
    share_after,
    state,
    random,
    out,
):
    """Advance the pixel blocks ``first <= block < stop`` by all readouts of one call, in place.

    Shapes, with P pixels in blocks of 64: stack float32 (G, K, P) e- per readout; index int64 (T,);
    low_weight and high_weight float32 (T, G), the weights of knots index and index + 1 (gain included);
    words uint32 (T,), shared by all pixels, added to each lane's generator so that two lanes that walk the
    same stretch of its one cycle stay independent; response float32 (P,); fixed float32 (4, P): dark
    charge, mean threshold less NOISE_MEAN·slope, slope (threshold noise per unit of the byte sum), and
    the most charge kept over the threshold; state float32 (3, P): accumulated charge, current threshold,
    share of the next readout's charge that is collected; random uint32 (P,); out uint8 (P, ceil(T/8)).
    """
    groups, knots, pixels = stack.shape
    low = np.zeros(groups * LANES, np.float32)
    high = np.zeros(groups * LANES, np.float32)
    lane = np.zeros(8 * LANES, np.float32)
    bits = np.zeros(2 * LANES, np.uint32)  # generators, then the byte being filled
    one = np.float32(1.0)
    for block in range(first, stop):
        start = block * LANES
        width = min(LANES, pixels - start)
        for i in range(width):
            p = start + i
            lane[_ACCUMULATED + i] = state[0, p]
            lane[_THRESHOLD + i] = state[1, p]
            lane[_SHARE + i] = state[2, p]
            lane[_DARK + i] = fixed[0, p]
            lane[_BASE + i] = fixed[1, p]
            lane[_SLOPE + i] = fixed[2, p]
            lane[_CAP + i] = fixed[3, p]
            bits[i] = random[p]
        knot = -1
        for t in range(index.shape[0]):
            if index[t] != knot:
                knot = index[t]
                after = min(knot + 1, knots - 1)
                for g in range(groups):
                    for i in range(width):
                        low[g * LANES + i] = stack[g, knot, start + i] * response[start + i]
                        high[g * LANES + i] = stack[g, after, start + i] * response[start + i]
            a, b = low_weight[t, 0], high_weight[t, 0]
            for i in range(LANES):
                lane[_CHARGE + i] = lane[_DARK + i] + (a * low[i] + b * high[i])
            for g in range(1, groups):
                a, b = low_weight[t, g], high_weight[t, g]
                for i in range(LANES):
                    lane[_CHARGE + i] += a * low[g * LANES + i] + b * high[g * LANES + i]
            word = words[t]
            flag = np.uint32(1 << (t & 7))
            for i in range(LANES):
                # numba widens uint32 arithmetic to 64 bits: without the casts the generator is another one.
                x = bits[i]
                x ^= np.uint32(x << np.uint32(13))
                x ^= np.uint32(x >> np.uint32(17))
                x ^= np.uint32(x << np.uint32(5))
                bits[i] = x
                y = np.uint32(x + word)
                pairs = np.uint32(
                    (y & np.uint32(0x00FF00FF)) + (np.uint32(y >> np.uint32(8)) & np.uint32(0x00FF00FF))
                )
                total = np.uint32(np.uint32(pairs + np.uint32(pairs >> np.uint32(16))) & np.uint32(0x7FF))
                fresh = lane[_BASE + i] + lane[_SLOPE + i] * np.float32(np.int32(total))
                filled = lane[_ACCUMULATED + i] + lane[_SHARE + i] * lane[_CHARGE + i]
                threshold = lane[_THRESHOLD + i]
                excess = filled - threshold
                cap = lane[_CAP + i]
                kept = excess if excess < cap else cap
                fired = filled >= threshold
                lane[_ACCUMULATED + i] = kept if fired else filled
                lane[_THRESHOLD + i] = fresh if fired else threshold
                lane[_SHARE + i] = share_after if fired else one
                bits[LANES + i] |= flag if fired else np.uint32(0)
            if t & 7 == 7 or t == index.shape[0] - 1:
                for i in range(width):
                    out[start + i, t >> 3] = bits[LANES + i]
                for i in range(LANES):
                    bits[LANES + i] = 0
        for i in range(width):
            p = start + i
            state[0, p] = lane[_ACCUMULATED + i]
            state[1, p] = lane[_THRESHOLD + i]
            state[2, p] = lane[_SHARE + i]
            random[p] = bits[i]
