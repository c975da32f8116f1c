"""Temporal statistics of a recording: rates, intervals, counts in windows, and the variation of its light.

One pass over the spikes computes them all in a compiled loop. If the light varied, a second pass measures time by
the accumulated light.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

from saf_gen.addons.calibrate.recordings import BLOCK_FRAMES, Recording
from saf_gen.core.compiled import compiled
from saf_gen.core.cores import usable_cores
from saf_gen.errors import BadInput

# Compiled inner loop of the spike statistics: one pass over packed spikes, pixel by pixel and spike by spike.
#
# The state of each pixel is carried from block to block, so that memory does not grow with the length of the
# recording.


SERIES_FRAMES = 8
"""Length, in readouts, of the windows whose counts are summed; the light is sampled as often."""
LAGS = 11
"""Number of lags of the second differences of spike times: 1, 2, 4 … 1024 spikes."""

# Columns of the state, int64 (P, STATE): the first spike, the latest spike, the number of spikes, and, for each half of
# the recording, its first spike, its latest spike and its number of spikes.
FIRST, LATEST, NUMBER, HALF = 0, 1, 2, 3
STATE = HALF + 6
# Columns of the windows: the index of the current window, its count so far, and the sums of counts and of
# squared counts over complete windows.
WINDOW_INDEX, WINDOW_COUNT, WINDOW_SUM, WINDOW_SQUARES = 0, 1, 2, 3


@compiled
def accumulate(
    packed: Any, frames: Any, start: Any, middle: Any, complete: Any, times: Any,
    state: Any, windows: Any, anchors: Any, squares: Any, numbers: Any
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
    complete : int
        Readouts of the recording in complete windows.
    times : ndarray of float64, shape (frames,)
        Time of each readout of the block, in readouts of mean light.
    state : ndarray of int64, shape (P, STATE)
        State of each pixel.
    windows : ndarray of int64, shape (P, 4)
        Sums over windows.
    anchors : ndarray of float64, shape (P, LAGS, 2)
        Last two spike times at multiples of each lag.
    squares : ndarray of float64, shape (P, LAGS)
        Sums of squared second differences, by lag.
    numbers : ndarray of int64, shape (P, LAGS)
        Number of second differences, by lag.
    """
    for p in range(packed.shape[0]):
        latest, number = state[p, LATEST], state[p, NUMBER]
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
                half = HALF if t < middle else HALF + 3
                if state[p, half + 2] == 0:
                    state[p, half] = t
                state[p, half + 1] = t
                state[p, half + 2] += 1
                if t < complete:
                    index = t // SERIES_FRAMES
                    if index != windows[p, WINDOW_INDEX]:
                        windows[p, WINDOW_SQUARES] += windows[p, WINDOW_COUNT] ** 2
                        windows[p, WINDOW_INDEX] = index
                        windows[p, WINDOW_COUNT] = 0
                    windows[p, WINDOW_COUNT] += 1
                    windows[p, WINDOW_SUM] += 1
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
        state[p, LATEST], state[p, NUMBER] = latest, number


def finish(windows: np.ndarray) -> None:
    """Add the last window of every pixel to the sums of squares, in place."""
    windows[:, WINDOW_SQUARES] += windows[:, WINDOW_COUNT] ** 2
    windows[:, WINDOW_COUNT] = 0


Progress = Callable[[float], None]


@dataclass(frozen=True)
class SpikeStatistics:
    """Temporal statistics of a recording of T frames, H rows and W columns.

    Attributes
    ----------
    shape : tuple of int
        Shape of the recording, (T, H, W).
    counts : ndarray of int64, shape (H, W)
        Spikes of each pixel.
    interval : ndarray of float64, shape (H, W)
        Mean interval between the spikes of each pixel, readouts; NaN below two spikes.
    half_rates : ndarray of float64, shape (2, H, W)
        Rate of each pixel in the first and the second half, from the intervals within it; NaN below two spikes.
    series : ndarray of float64, shape (T div 8,)
        Mean spikes per pixel and readout in each run of 8 readouts.
    series_variance : float
        Variance that a value of ``series`` would have in steady light, from the variances of the single pixels.
    squares : ndarray of float64, shape (H, W, LAGS)
        Sums of squared second differences of spike times at lags of 1, 2, 4 … spikes, in readouts² of mean light.
    numbers : ndarray of int32, shape (H, W, LAGS)
        Number of second differences at each lag.
    """

    shape: tuple[int, int, int]
    counts: np.ndarray
    interval: np.ndarray
    half_rates: np.ndarray
    series: np.ndarray
    series_variance: float
    squares: np.ndarray
    numbers: np.ndarray

    @property
    def mean_rate(self) -> float:
        """Mean over the pixels, spikes per readout."""
        return float(self.counts.mean() / self.shape[0])

    @property
    def rates(self) -> np.ndarray:
        """Rate of each pixel, spikes per readout, (H, W).

        From 20 spikes on it is computed from the intervals, with a hundredth of the error of counting; with fewer
        spikes, from the count.
        """
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self.counts >= 20, 1 / self.interval, self.counts / self.shape[0])


def measure_spikes(
    recording: Recording, *, light: np.ndarray | None = None, report: Progress | None = None
) -> SpikeStatistics:
    """Return the temporal statistics of a recording.

    Parameters
    ----------
    recording : Recording
        The recording to measure.
    light : ndarray, shape (T div 8,), optional
        Light of each run of 8 readouts, divided by its mean; times are stretched by it. By default light is steady.
    report : callable, optional
        Called with the fraction that is done.

    Raises
    ------
    BadInput
        If the recording has fewer than 16 readouts.
    """
    frames, height, width = recording.shape
    if frames < 2 * SERIES_FRAMES:
        raise BadInput(f"has {frames} readouts", where=recording.name, allowed=f"at least {2 * SERIES_FRAMES}")
    pixels = height * width
    state = np.zeros((pixels, STATE), np.int64)
    windows = np.zeros((pixels, 4), np.int64)
    anchors, squares = np.zeros((pixels, LAGS, 2)), np.zeros((pixels, LAGS))
    numbers = np.zeros((pixels, LAGS), np.int64)
    complete = frames // SERIES_FRAMES * SERIES_FRAMES
    times = _stretched_times(light, frames)
    series = np.zeros(-(-frames // SERIES_FRAMES))
    threads = min(usable_cores(), height)
    cuts = np.linspace(0, pixels, threads + 1).astype(int).tolist()
    start = 0
    with ThreadPoolExecutor(threads) as pool:
        for block in recording.blocks():
            packed = np.ascontiguousarray(block).reshape(pixels, -1)
            count = min(BLOCK_FRAMES, frames - start)
            jobs = [
                pool.submit(
                    accumulate, packed[a:b], count, start, frames // 2, complete,
                    times[start : start + count], state[a:b], windows[a:b],
                    anchors[a:b], squares[a:b], numbers[a:b],
                )
                for a, b in pairwise(cuts)
            ]  # fmt: skip
            first = start // SERIES_FRAMES
            series[first : first + packed.shape[1]] = np.bitwise_count(packed).sum(axis=0, dtype=np.int64)
            for job in jobs:
                job.result()
            start += count
            if report is not None:
                report(start / frames)
    finish(windows)
    return _summarise(recording.shape, state, windows=windows, series=series, lags=(squares, numbers))


def _stretched_times(light: np.ndarray | None, frames: int) -> np.ndarray:
    """Return the time of the end of each readout, in readouts of mean light, float64 (frames,)."""
    if light is None:
        return np.arange(1.0, frames + 1)
    step = np.repeat(light, SERIES_FRAMES)
    step = np.concatenate([step, np.ones(max(0, frames - step.size))])[:frames]
    return np.cumsum(step)


def _summarise(
    shape: tuple[int, int, int],
    state: np.ndarray,
    *,
    windows: np.ndarray,
    series: np.ndarray,
    lags: tuple[np.ndarray, np.ndarray],
) -> SpikeStatistics:
    frames, size = shape[0], shape[1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        counts = state[:, NUMBER]
        span = state[:, LATEST] - state[:, FIRST]
        interval = np.where(counts >= 2, span / (counts - 1), np.nan)
        halves = state[:, HALF:].reshape(-1, 2, 3).astype(np.float64)
        spans = halves[:, :, 1] - halves[:, :, 0]
        half_rates = np.where(spans > 0, (halves[:, :, 2] - 1) / spans, np.nan)
    runs = frames // SERIES_FRAMES
    mean = windows[:, WINDOW_SUM] / runs
    spread = (windows[:, WINDOW_SQUARES] - runs * mean**2) / (runs - 1)
    variance = float(spread.mean()) / (SERIES_FRAMES**2 * counts.size)
    return SpikeStatistics(
        shape=shape,
        counts=counts.reshape(size),
        interval=interval.reshape(size),
        half_rates=half_rates.T.reshape(2, *size),
        series=series[:runs] / (SERIES_FRAMES * counts.size),
        series_variance=variance,
        squares=lags[0].reshape(*size, -1),
        numbers=lags[1].reshape(*size, -1).astype(np.int32),
    )


def flat_areas(rates: np.ndarray) -> np.ndarray:
    """Return the quarter of the pixels with the smallest relative gradient of the smoothed rates, bool (H, W).

    The Gaussian that smooths the rates has a standard deviation of 3 pixels, so that the noise of a pixel does not
    decide whether it is selected.
    """
    known = np.where(np.isfinite(rates), rates, 0.0)
    smooth = gaussian_filter(known, 3.0)
    slope = np.hypot(*np.gradient(smooth)) / np.maximum(smooth, 1e-12)
    return slope <= np.quantile(slope, 0.25)
