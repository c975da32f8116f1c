"""Compiled inner loop of the spike statistics: one pass over packed spikes, pixel by pixel and spike by spike.

The state of each pixel is carried from block to block, so that memory does not grow with the length of the recording.
"""

from typing import Any

import numpy as np

from saf_gen.core.compiled import compiled

WINDOWS = (8, 10, 20, 50)
"""Lengths, in readouts, of the windows whose counts are summed; the light is also sampled every 8 readouts."""
LAGS = 11
"""Number of lags of the second differences of spike times: 1, 2, 4 … 1024 spikes."""

# Columns of the state, int64 (P, STATE): the first spike, the latest spike, the interval before it, the number of
# spikes, and, for each half of the recording, its first spike, its latest spike and its number of spikes.
FIRST, LATEST, INTERVAL, NUMBER, HALF = 0, 1, 2, 3, 4
STATE = HALF + 6
# Columns of the sums, float64 (P, SUMS): the sum of 2·|d₂ − d₁|/(d₁ + d₂) and its number of terms; the sum of
# |d₂ − d₁| over pairs with both intervals in the band, and its number of terms.
CV2, CV2_NUMBER, CHANGE, CHANGE_NUMBER = 0, 1, 2, 3
SUMS = 4
# Columns for each window length: the index of the current window, its count so far, and the sums of counts and of
# squared counts over complete windows.
WINDOW_INDEX, WINDOW_COUNT, WINDOW_SUM, WINDOW_SQUARES = 0, 1, 2, 3


@compiled
def accumulate_spike_statistics(
    packed: Any, frames: Any, start: Any, middle: Any, complete: Any, times: Any, band: Any,
    state: Any, sums: Any, windows: Any, anchors: Any, squares: Any, numbers: Any
) -> Any:  # fmt: skip
    """Add a block of readouts to the state of every pixel, in place.

    Parameters
    ----------
    packed : ndarray of uint8, shape (P, bytes)
        Spikes of P pixels, one bit per readout.
    frames : int
        Readouts in the block.
    start : int
        Number of the block's first readout in the recording.
    middle : int
        First readout of the second half of the recording.
    complete : ndarray of int64, shape (len(WINDOWS),)
        Readouts of the recording in complete windows, for each window length.
    times : ndarray of float64, shape (frames,)
        Time of each readout of the block, in readouts of mean light.
    band : ndarray of int64, shape (2,)
        Shortest and longest interval of the band.
    state : ndarray of int64, shape (P, STATE)
        State of each pixel.
    sums : ndarray of float64, shape (P, SUMS)
        Sums over pairs of intervals.
    windows : ndarray of int64, shape (P, len(WINDOWS), 4)
        Sums over windows.
    anchors : ndarray of float64, shape (P, LAGS, 2)
        Last two spike times at multiples of each lag.
    squares : ndarray of float64, shape (P, LAGS)
        Sums of squared second differences, by lag.
    numbers : ndarray of int64, shape (P, LAGS)
        Number of second differences, by lag.
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
                    if t < complete[w]:
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
    """Add the last window of every pixel to the sums of squares, in place."""
    windows[:, :, WINDOW_SQUARES] += windows[:, :, WINDOW_COUNT] ** 2
    windows[:, :, WINDOW_COUNT] = 0
