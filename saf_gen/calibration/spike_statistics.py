"""Temporal statistics of a recording: rates, intervals, counts in windows, and the variation of its light.

One pass over the spikes computes them all (``spike_kernel.py``). If the light varied, a second pass measures time by
the accumulated light.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter

from saf_gen.calibration import spike_kernel as kernel
from saf_gen.calibration.recordings import BLOCK_FRAMES, Recording
from saf_gen.core.cores import usable_cores
from saf_gen.errors import BadInput

CHANGE_BAND = (20, 30)
"""Shortest and longest interval, in readouts, for which the change to the next interval is averaged."""
SERIES_FRAMES = kernel.WINDOWS[0]
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
    cv2 : float
        Mean of 2·|d₂ − d₁|/(d₁ + d₂) over all pairs of consecutive intervals d₁, d₂; NaN if there are no pairs.
    interval_change : float
        Mean of |d₂ − d₁| over pairs in which both intervals are 20 to 30 readouts; NaN if there are no such pairs.
    fano : dict of int to float
        By window length of 10, 20 and 50 readouts: temporal variance of counts, averaged over the pixels, divided by
        the mean count.
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
    cv2: float
    interval_change: float
    fano: dict[int, float]
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


def measure_spike_statistics(
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
    state = np.zeros((pixels, kernel.STATE), np.int64)
    sums = np.zeros((pixels, kernel.SUMS))
    windows = np.zeros((pixels, len(kernel.WINDOWS), 4), np.int64)
    anchors, squares = np.zeros((pixels, kernel.LAGS, 2)), np.zeros((pixels, kernel.LAGS))
    numbers = np.zeros((pixels, kernel.LAGS), np.int64)
    complete = np.array([frames // w * w for w in kernel.WINDOWS])
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
                    kernel.accumulate_spike_statistics, packed[a:b], count, start, frames // 2, complete,
                    times[start : start + count], np.array(CHANGE_BAND), state[a:b], sums[a:b], windows[a:b],
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
    kernel.finish_spike_statistics(windows)
    return _summarise(recording.shape, state, sums=sums, windows=windows, series=series, lags=(squares, numbers))


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
    sums: np.ndarray,
    windows: np.ndarray,
    series: np.ndarray,
    lags: tuple[np.ndarray, np.ndarray],
) -> SpikeStatistics:
    frames, size = shape[0], shape[1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        counts = state[:, kernel.NUMBER]
        span = state[:, kernel.LATEST] - state[:, kernel.FIRST]
        interval = np.where(counts >= 2, span / (counts - 1), np.nan)
        halves = state[:, kernel.HALF :].reshape(-1, 2, 3).astype(np.float64)
        spans = halves[:, :, 1] - halves[:, :, 0]
        half_rates = np.where(spans > 0, (halves[:, :, 2] - 1) / spans, np.nan)
        total = sums.sum(axis=0)
        cv2 = float(total[kernel.CV2] / total[kernel.CV2_NUMBER])
        change = float(total[kernel.CHANGE] / total[kernel.CHANGE_NUMBER])
    fano, variance = {}, 0.0
    for w, length in enumerate(kernel.WINDOWS):
        number = frames // length
        if number < 2:
            continue
        mean = windows[:, w, kernel.WINDOW_SUM] / number
        spread = (windows[:, w, kernel.WINDOW_SQUARES] - number * mean**2) / (number - 1)
        if length == SERIES_FRAMES:
            variance = float(spread.mean()) / (SERIES_FRAMES**2 * counts.size)
        elif mean.any():
            fano[length] = float(spread.mean() / mean.mean())
    runs = frames // SERIES_FRAMES
    return SpikeStatistics(
        shape=shape,
        counts=counts.reshape(size),
        interval=interval.reshape(size),
        cv2=cv2,
        interval_change=change,
        fano=fano,
        half_rates=half_rates.T.reshape(2, *size),
        series=series[:runs] / (SERIES_FRAMES * counts.size),
        series_variance=variance,
        squares=lags[0].reshape(*size, -1),
        numbers=lags[1].reshape(*size, -1).astype(np.int32),
    )


def flat_areas_for_statistics(rates: np.ndarray) -> np.ndarray:
    """Return the quarter of the pixels with the smallest relative gradient of the smoothed rates, bool (H, W).

    The Gaussian that smooths the rates has a standard deviation of 3 pixels, so that the noise of a pixel does not
    decide whether it is selected.
    """
    known = np.where(np.isfinite(rates), rates, 0.0)
    smooth = gaussian_filter(known, 3.0)
    slope = np.hypot(*np.gradient(smooth)) / np.maximum(smooth, 1e-12)
    return slope <= np.quantile(slope, 0.25)


def rms_statistic_between_halves(statistics: SpikeStatistics) -> float:
    """Return the relative temporal rms of the rate over half a recording, from the two halves, in flat areas.

    The median difference, which is a change of the light between the halves, is subtracted. Returns NaN if fewer than
    two pixels in flat areas have rates in both halves.
    """
    first, second = statistics.half_rates
    with np.errstate(invalid="ignore"):
        relative = 2 * (second - first) / (first + second)
    known = relative[np.isfinite(relative) & flat_areas_for_statistics(statistics.rates)]
    if known.size < 2:
        return float("nan")
    return float(np.std(known - np.median(known)) / np.sqrt(2))
