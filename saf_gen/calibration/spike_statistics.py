"""Statistics of a recording in time: rates, intervals, counts in windows, and how its light varied.

One pass over the spikes gives all of them (``spike_kernel.py``); a second pass is made where the light varied, with the
times of the readouts in units of the light that fell so far.
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
"""Intervals, in readouts, whose change to the next one is averaged."""
SERIES_FRAMES = kernel.WINDOWS[0]
Progress = Callable[[float], None]


@dataclass(frozen=True)
class SpikeStatistics:
    """What one pass over a recording of P = H·W pixels gives; maps are (H, W).

    shape : (T, H, W).
    counts : spikes of each pixel, int64.
    interval : mean interval between a pixel's spikes, readouts; NaN below two spikes.
    cv2 : mean of 2·|d₂ − d₁|/(d₁ + d₂) over all neighbouring intervals d₁, d₂; NaN where there are none.
    interval_change : mean of |d₂ − d₁| where both are of 20 to 30 readouts; NaN where there are none.
    fano : by window of 10, 20 and 50 readouts: mean over pixels of the variance of counts in time, over their mean.
    half_rates : rate of each pixel in the first and the second half, (2, H, W), from the intervals within it;
        NaN below two spikes.
    series : spikes per pixel and readout in each run of 8 readouts, (T div 8,).
    series_variance : variance of such a mean that pixels in steady light would have, from the variance of each.
    squares, numbers : sums of squared second differences of spike times, in readouts² of mean light, and how many, at
        lags of 1, 2, 4 … spikes, (H, W, LAGS).
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
        """Spikes per pixel and readout."""
        return float(self.counts.mean() / self.shape[0])

    @property
    def rates(self) -> np.ndarray:
        """Rate of each pixel: from its intervals, which has a hundredth of the error of a count; from its count below
        20 spikes."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self.counts >= 20, 1 / self.interval, self.counts / self.shape[0])


def measure_spike_statistics(
    recording: Recording, *, light: np.ndarray | None = None, report: Progress | None = None
) -> SpikeStatistics:
    """Return the statistics of a recording.

    Parameters
    ----------
    recording : the spikes.
    light : light of each run of 8 readouts over its mean, (T div 8,), by which times are stretched; steady by default.
    report : receives the fraction that is done.

    Raises
    ------
    BadInput : a recording of fewer than 16 readouts.
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
    whole = np.array([frames // w * w for w in kernel.WINDOWS])
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
                    kernel.accumulate_spike_statistics, packed[a:b], count, start, frames // 2, whole,
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
    """Return the quarter of the pixels, bool (H, W), where smoothed rates have the smallest gradient over their value.

    The rates are smoothed over 3 pixels (standard deviation), so that a pixel's own noise does not choose it.
    """
    known = np.where(np.isfinite(rates), rates, 0.0)
    smooth = gaussian_filter(known, 3.0)
    slope = np.hypot(*np.gradient(smooth)) / np.maximum(smooth, 1e-12)
    return slope <= np.quantile(slope, 0.25)


def rms_statistic_between_halves(statistics: SpikeStatistics) -> float:
    """Return the temporal rms of a half's rate over its mean, from the difference of two halves, in flat areas.

    The median difference, a change of the light from half to half, is left out.
    """
    first, second = statistics.half_rates
    with np.errstate(invalid="ignore"):
        relative = 2 * (second - first) / (first + second)
    known = relative[np.isfinite(relative) & flat_areas_for_statistics(statistics.rates)]
    if known.size < 2:
        return float("nan")
    return float(np.std(known - np.median(known)) / np.sqrt(2))
