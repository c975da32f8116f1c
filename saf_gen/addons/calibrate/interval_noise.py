"""The noise of intervals, 1/θ + σ², from second differences of spike times.

The time of a spike is an integer number of readouts, tⱼ = ⌈Sⱼ⌉. From spike to spike, Sⱼ grows by m on average, with the
variance s² = v·(m − ℓ)², where v = 1/θ + σ² and ℓ is the fraction of a readout that is lost after a spike. The phase
eⱼ = tⱼ − Sⱼ is uniform over a readout and independent of the growth of S. The second difference at a lag of k spikes,
t₂ₖ − 2tₖ + t₀, therefore has the variance

    2·k·s² + Var(e₂ₖ − 2eₖ + e₀) = 2·k·s² + 1/2 − 4·O(k) + O(2k)

where O(k) is twice the covariance of two phases k spikes apart: the oscillation of the exact law of intervals at the
mean k·m and the variance k·s² (docs/spike-camera.md). The mean interval and a steady drift of the light do
not add to it. At long lags the noise exceeds the phases, and O vanishes.
"""

from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
from scipy import stats

from saf_gen.addons.calibrate.estimates import NORMAL_95, Estimate, root_estimate
from saf_gen.addons.calibrate.spike_statistics import LAGS, SpikeStatistics
from saf_gen.camera.counting_law import TERMS, count_oscillation

START_NOISE = 1e-4
"""Value of v before the first fit, and if the recordings do not determine it."""
_MIN_PIXELS = 200
_SIGNIFICANCE = 1e-3
_ROUNDS = 4


def difference_variance(
    interval: np.ndarray, noise: float, *, lag: int, loss: float = 0.0, stretch: float = 1.0
) -> np.ndarray:
    """Return the variance, in readouts², of second differences of spike times at a given lag.

    Parameters
    ----------
    interval : ndarray
        Mean interval of each pixel, readouts.
    noise : float
        Relative variance of an interval, v = 1/θ + σ².
    lag : int
        Spikes from each of the three times to the next.
    loss : float, default 0
        Readouts lost after a spike, ℓ.
    stretch : float, default 1
        Mean square of the length of a readout if times are stretched by the light; 1 in steady light.
    """
    grown = noise * (interval - loss) ** 2
    phases = (
        0.5
        - 4 * phase_oscillation(lag * interval, lag * grown)
        + phase_oscillation(2 * lag * interval, 2 * lag * grown)
    )
    return 2 * lag * grown + stretch * phases


def phase_oscillation(mean: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Return :func:`saf_gen.camera.counting_law.count_oscillation` within 10⁻¹², in a quarter of the time.

    The cosines and exponentials of the series are computed by recurrence: cos(2πkX) is the real part of a k-th power,
    and the ratio of consecutive e^(−ak²) falls by a constant factor.
    """
    smallest = float(variance.min(initial=np.inf))
    if smallest > 1.5:  # the first term is below 10⁻¹³
        return np.zeros(mean.shape)
    if smallest > 0.1:  # for a few terms the direct sum is faster
        return count_oscillation(mean, variance)
    last = TERMS if smallest <= 0 else min(TERMS, int(np.sqrt(40 / (2 * np.pi**2 * smallest))) + 1)
    turn = np.exp(2j * np.pi * (mean % 1))
    fall = np.exp(-2 * np.pi**2 * variance)
    wave, ratio, squared, out = turn.copy(), fall**3, fall**2, np.zeros(mean.shape)
    for k in range(1, last + 1):
        out += wave.real * fall / k**2
        wave *= turn
        fall *= ratio
        ratio *= squared
    return out / np.pi**2


def interpolate_variance(
    interval: np.ndarray, noise: float, *, lag: int, loss: float = 0.0, stretch: float = 1.0
) -> np.ndarray:
    """Return :func:`difference_variance` of many pixels, interpolated between intervals.

    At an interval m, the law is smooth over a scale of √(lag·noise)·(m − ℓ)/lag. Steps of a 64th of this scale give an
    error below 10⁻⁴ readout². If as many steps as pixels are needed, the law is evaluated for each pixel instead.
    """
    low, high = (max(float(end) - loss, 1e-3) for end in (interval.min(), interval.max()))
    steps = int(np.log(high / low) / np.sqrt(noise / lag) * 64) + 2
    if steps >= interval.size:
        return difference_variance(interval, noise, lag=lag, loss=loss, stretch=stretch)
    grid = loss + np.geomspace(low, high, steps)
    law = difference_variance(grid, noise, lag=lag, loss=loss, stretch=stretch)
    return np.interp(interval, grid, law)


def fit_interval_noise(
    statistics: SpikeStatistics, *, loss: float = 0.0, stretch: float = 1.0, max_lag: int = 1 << LAGS
) -> tuple[float, float]:
    """Return v = 1/θ + σ² of a recording in even light, and its standard error.

    At each lag with enough second differences, the sum of their squares in each pixel is matched with the law at the
    mean interval of the pixel. This is a generalised method of moments (Hansen 1982, doi:10.2307/1912775); its weights
    and its error follow from the covariance of the sums over the pixels.

    Parameters
    ----------
    statistics : SpikeStatistics
        Statistics of the recording.
    loss : float, default 0
        Readouts lost after a spike, ℓ.
    stretch : float, default 1
        Mean square of the length of a readout if times are stretched by the light; 1 in steady light.
    max_lag : int, default 2048
        Longest lag to use, in spikes.

    Returns
    -------
    tuple of float
        v and its standard error; (NaN, ∞) if fewer than 200 pixels have at least 16 spikes, or if the sums carry no
        information, such as when all intervals are equal.
    """
    used = (statistics.counts >= 16) & np.isfinite(statistics.interval)
    if used.sum() < _MIN_PIXELS:
        return float("nan"), float("inf")
    interval = statistics.interval[used]
    squares, numbers = statistics.squares[used], statistics.numbers[used]
    usable = [lag for lag in range(LAGS) if 1 << lag <= min(np.median(statistics.counts[used]) / 8, max_lag)]
    longest = usable[-1]
    steady = squares[:, longest].sum() - stretch / 2 * numbers[:, longest].sum()
    grown = 2 * (1 << longest) * ((interval - loss) ** 2 * numbers[:, longest]).sum()
    noise, error = max(float(steady / grown), 2e-5), float("inf")
    for _ in range(_ROUNDS):
        off, slope = _moments(
            interval, squares=squares, numbers=numbers, usable=usable, noise=noise, loss=loss, stretch=stretch
        )
        kept = _find_informative_lags(off, slope)
        spread = np.cov(off[:, kept], rowvar=False).reshape(len(kept), len(kept))
        weight = np.linalg.pinv(spread, hermitian=True) @ slope[kept]
        information = float(slope[kept] @ weight)
        if not information > 0:
            return float("nan"), float("inf")
        step = float(off[:, kept].mean(axis=0) @ weight) / information
        error = float(1 / np.sqrt(information * interval.size))
        noise = max(noise + step, 1e-7)
        if abs(step) < 0.01 * error:
            break
    return noise, error


def _moments(
    interval: np.ndarray,
    *,
    squares: np.ndarray,
    numbers: np.ndarray,
    usable: list[int],
    noise: float,
    loss: float,
    stretch: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the excess of the sums of squared second differences over their expectation, and the slope of the latter.

    The excess is (pixels, lags). The slope, (lags,), is the derivative of the expectation with respect to ``noise``,
    averaged over the pixels.
    """
    off, slope = np.empty((interval.size, len(usable))), np.empty(len(usable))
    for at, lag in enumerate(usable):
        law, more = (
            interpolate_variance(interval, v, lag=1 << lag, loss=loss, stretch=stretch) for v in (noise, 1.02 * noise)
        )
        off[:, at] = squares[:, lag] - numbers[:, lag] * law
        slope[at] = np.mean(numbers[:, lag] * (more - law)) / (0.02 * noise)
    return off, slope


def _find_informative_lags(off: np.ndarray, slope: np.ndarray) -> list[int]:
    """Return the lags that carry at least a hundredth of the information of the best lag."""
    information = slope**2 / np.maximum(off.var(axis=0), 1e-300)
    return [at for at in range(slope.size) if information[at] > 0.01 * information.max()]


@dataclass(frozen=True)
class NoiseOfLevels:
    """The noise of intervals, estimated from several levels together.

    Attributes
    ----------
    value : float
        Relative variance of an interval, v = 1/θ + σ².
    error : float
        Standard error of the value.
    jitter : Estimate or None
        Reset jitter, readouts, which adds the same variance to short and long intervals; None with one level.
    agree : bool
        True if one v and one jitter explain all levels, at a significance of 1e-3.
    """

    value: float
    error: float
    jitter: Estimate | None
    agree: bool


def combine_noise(found: list[tuple[float, float]], lengths: list[float]) -> NoiseOfLevels:
    """Return the joint noise of several levels.

    A reset jitter of j readouts raises v at a level to v + j²/(m − ℓ)². If the levels show no significant jitter, the
    estimate is 0, with an upper bound.

    Parameters
    ----------
    found : list of tuple of float
        v and its standard error, for each level.
    lengths : list of float
        Mean interval without the loss, m − ℓ, for each level, readouts.
    """
    known = [(v, e, length) for (v, e), length in zip(found, lengths, strict=True) if np.isfinite(v) and np.isfinite(e)]
    if not known:
        return NoiseOfLevels(START_NOISE, inf, None, True)
    values, errors, at = (np.array(column) for column in zip(*known, strict=True))
    weight = 1 / errors**2
    value, error = float(np.average(values, weights=weight)), float(1 / np.sqrt(weight.sum()))
    off = float((((values - value) / errors) ** 2).sum())
    if len(known) < 2:
        return NoiseOfLevels(value, error, None, True)
    how = "noise of short intervals compared with long intervals"
    design = np.stack([np.ones(len(known)), 1 / at**2], axis=1) / errors[:, None]
    spread = np.linalg.pinv(design.T @ design)
    solution = spread @ design.T @ (values / errors)
    wide = sqrt(spread[1, 1])
    if solution[1] > stats.norm.isf(_SIGNIFICANCE / 2) * wide:
        rest = float(((values / errors - design @ solution) ** 2).sum())
        agree = len(known) < 3 or stats.chi2.sf(rest, len(known) - 2) > _SIGNIFICANCE
        return NoiseOfLevels(
            float(solution[0]), sqrt(spread[0, 0]), root_estimate(float(solution[1]), wide, how=how), bool(agree)
        )
    agree = stats.chi2.sf(off, len(known) - 1) > _SIGNIFICANCE
    bound = Estimate(0.0, 0.0, sqrt(max(solution[1] + NORMAL_95 * wide, 0.0)), how)
    return NoiseOfLevels(value, error if agree else error * sqrt(off / (len(known) - 1)), bound, bool(agree))
