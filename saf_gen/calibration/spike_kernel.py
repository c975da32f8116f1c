"""The compiled inner loop of the statistics: one pass over packed spikes, pixel by pixel, spike by spike.

The state of a pixel is carried from block to block, so that memory does not grow with the length of the recording.
"""

from typing import Any

import numpy as np

from saf_gen.core.compiled import compiled

WINDOWS = (8, 10, 20, 50)
"""Lengths, in readouts, of the windows whose counts are kept; 8 is that of the series of the light."""
LAGS = 11
"""Second differences of spike times are kept at lags of 1, 2, 4 … 1024 spikes."""

# Columns of the state, int64 (P, STATE): the first spike, the latest, the interval before it, the number of spikes,
# and, for each half of the recording, the first spike, the latest and their number.
FIRST, LATEST, INTERVAL, NUMBER, HALF = 0, 1, 2, 3, 4
STATE = HALF + 6
# Columns of the sums, float64 (P, SUMS): of 2·|d₂ − d₁|/(d₁ + d₂) and its number, of |d₂ − d₁| where both lie in the
# band of intervals, and its number.
CV2, CV2_NUMBER, CHANGE, CHANGE_NUMBER = 0, 1, 2, 3
SUMS = 4
# Of each window: its index, its count so far, and the sums of counts and of squared counts of whole windows.
WINDOW_INDEX, WINDOW_COUNT, WINDOW_SUM, WINDOW_SQUARES = 0, 1, 2, 3


@compiled
def accumulate_spike_statistics(
    packed: Any, frames: Any, start: Any, middle: Any, whole: Any, times: Any, band: Any,
    state: Any, sums: Any, windows: Any, anchors: Any, squares: Any, numbers: Any
) -> Any:  # fmt: skip
    """Add ``frames`` readouts, of which ``start`` is the first, to the state of every pixel, in place.

    Shapes, with P pixels: packed uint8 (P, bytes); times float64 (frames,), the time of each readout, in readouts of
    mean light; middle, the first readout of the second half; whole int64 (len(WINDOWS),), readouts in whole windows;
    band int64 (2,), shortest and longest interval of the band; state int64 (P, STATE); sums float64 (P, SUMS); windows
    int64 (P, len(WINDOWS), 4); anchors float64 (P, LAGS, 2), the last two spike times at multiples of each lag; squares
    float64 (P, LAGS) and numbers int64 (P, LAGS): sums of squared second differences, and how many.
    """
    for p in range(packed.shape[0]):
        latest, interval, number = state[p, LATEST], state[p, INTERVAL], state[p, NUMBER]
        for b in range(packed.shape[1]):
            byte = packed[p, b]
            if byte == 0:
                continue
            for bit in range(8):
                if not (byte >> bit) & 1:
                    continue
                local = 8 * b + bit
                if local >= frames:
                    break
                t = start + local
                if number == 0:
                    state[p, FIRST] = t
                else:
                    d = t - latest
                    if interval > 0:
                        change = abs(d - interval)
                        sums[p, CV2] += 2.0 * change / (d + interval)
                        sums[p, CV2_NUMBER] += 1
                        if band[0] <= d <= band[1] and band[0] <= interval <= band[1]:
                            sums[p, CHANGE] += change
                            sums[p, CHANGE_NUMBER] += 1
                    interval = d
                half = HALF if t < middle else HALF + 3
                if state[p, half + 2] == 0:
                    state[p, half] = t
                state[p, half + 1] = t
                state[p, half + 2] += 1
                for w in range(windows.shape[1]):
                    if t < whole[w]:
                        index = t // WINDOWS[w]
                        if index != windows[p, w, WINDOW_INDEX]:
                            windows[p, w, WINDOW_SQUARES] += windows[p, w, WINDOW_COUNT] ** 2
                            windows[p, w, WINDOW_INDEX] = index
                            windows[p, w, WINDOW_COUNT] = 0
                        windows[p, w, WINDOW_COUNT] += 1
                        windows[p, w, WINDOW_SUM] += 1
                time = times[local]
                for lag in range(LAGS):
                    if number & ((1 << lag) - 1):
                        break
                    step = number >> lag
                    if step >= 2:
                        second = time - 2.0 * anchors[p, lag, 1] + anchors[p, lag, 0]
                        squares[p, lag] += second * second
                        numbers[p, lag] += 1
                    anchors[p, lag, 0] = anchors[p, lag, 1]
                    anchors[p, lag, 1] = time
                latest = t
                number += 1
        state[p, LATEST], state[p, INTERVAL], state[p, NUMBER] = latest, interval, number


def finish_spike_statistics(windows: np.ndarray) -> None:
    """Close the last window of every pixel, in place."""
    windows[:, :, WINDOW_SQUARES] += windows[:, :, WINDOW_COUNT] ** 2
    windows[:, :, WINDOW_COUNT] = 0
