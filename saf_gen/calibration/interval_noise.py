"""The noise of intervals, 1/θ + σ², from second differences of spike times.

The time of a spike is a whole number of readouts: tⱼ = ⌈Sⱼ⌉. Sⱼ grows from spike to spike by m, with the variance
s² = v·(m − ℓ)², v = 1/θ + σ², ℓ the fraction of a readout lost after a spike. The phase eⱼ = tⱼ − Sⱼ is even over a
readout and independent of how S grows. So the second difference at a lag of k spikes, t₂ₖ − 2tₖ + t₀, has the variance

    2·k·s² + Var(e₂ₖ − 2eₖ + e₀) = 2·k·s² + 1/2 − 4·O(k) + O(2k)

where O(k) is twice the covariance of two phases k spikes apart, the oscillation of the exact law of intervals at the
mean k·m and the variance k·s² (docs/explanation/spike-camera.md). It knows neither the mean interval nor a steady drift
of the light. At long lags the noise outgrows the phases, and O is nothing.
"""

from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
from scipy import stats

from saf_gen.calibration.estimates import NORMAL_95, Estimate, root_estimate_of_fit
from saf_gen.calibration.spike_kernel import LAGS
from saf_gen.calibration.spike_statistics import SpikeStatistics
from saf_gen.camera.counting_law import TERMS, pixel_count_oscillation

START_NOISE = 1e-4
"""v where nothing is known of it yet, and where a recording does not tell it."""
_LEAST_PIXELS = 200
_SIGNIFICANCE = 1e-3
_ROUNDS = 4


def difference_variance_to_fit(
    interval: np.ndarray, noise: float, *, lag: int, loss: float = 0.0, stretch: float = 1.0
) -> np.ndarray:
    """Return the variance, in readouts², of second differences at a lag of so many spikes.

    Parameters
    ----------
    interval : mean interval of each pixel, readouts.
    noise : v = 1/θ + σ², the relative variance of a threshold.
    lag : spikes between the three times.
    loss : ℓ, readouts lost after a spike.
    stretch : mean square of the length of a readout, where times are stretched by the light; 1 in steady light.
    """
    grown = noise * (interval - loss) ** 2
    phases = (
        0.5
        - 4 * oscillation_to_fit(lag * interval, lag * grown)
        + oscillation_to_fit(2 * lag * interval, 2 * lag * grown)
    )
    return 2 * lag * grown + stretch * phases


def oscillation_to_fit(mean: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Return :func:`saf_gen.camera.counting_law.pixel_count_oscillation` of arrays, to 10⁻¹², in a quarter of the time.

    Cosines and exponentials of its terms follow from those before: cos(2πkX) is the real part of a k-th power, and
    e^(−ak²) falls from term to term by a factor that itself falls by one that stays.
    """
    smallest = float(variance.min(initial=np.inf))
    if smallest > 1.5:  # the first term is below 10⁻¹³
        return np.zeros(mean.shape)
    if smallest > 0.1:  # a few terms, which are sooner taken one by one
        return pixel_count_oscillation(mean, variance)
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


def interpolated_variance_to_fit(
    interval: np.ndarray, noise: float, *, lag: int, loss: float = 0.0, stretch: float = 1.0
) -> np.ndarray:
    """Return :func:`difference_variance_to_fit` of many pixels, interpolated between intervals.

    The law is smooth over √(lag·noise)·(m − ℓ)/lag of an interval m: steps are a 64th of that, which leaves less
    than 10⁻⁴ of a readout². With as many steps as pixels it is taken pixel by pixel.
    """
    least, most = (max(float(end) - loss, 1e-3) for end in (interval.min(), interval.max()))
    steps = int(np.log(most / least) / np.sqrt(noise / lag) * 64) + 2
    if steps >= interval.size:
        return difference_variance_to_fit(interval, noise, lag=lag, loss=loss, stretch=stretch)
    places = loss + np.geomspace(least, most, steps)
    law = difference_variance_to_fit(places, noise, lag=lag, loss=loss, stretch=stretch)
    return np.interp(interval, places, law)


def fit_interval_noise(
    statistics: SpikeStatistics, *, loss: float = 0.0, stretch: float = 1.0, most_lag: int = 1 << LAGS
) -> tuple[float, float]:
    """Return v = 1/θ + σ² of a recording in even light, and its standard error.

    The sums of squares of every pixel, at each lag that has enough of them, are matched with what the law says for the
    pixel's own mean interval: a generalised method of moments (Hansen 1982, doi:10.2307/1912775), whose weights and
    error are the covariance of the sums over the pixels. ``most_lag`` spikes is the longest lag. Returns (NaN, ∞)
    where fewer than 200 pixels have 16 spikes, or all intervals are the same.
    """
    used = (statistics.counts >= 16) & np.isfinite(statistics.interval)
    if used.sum() < _LEAST_PIXELS:
        return float("nan"), float("inf")
    interval = statistics.interval[used]
    squares, numbers = statistics.squares[used], statistics.numbers[used]
    usable = [lag for lag in range(LAGS) if 1 << lag <= min(np.median(statistics.counts[used]) / 8, most_lag)]
    longest = usable[-1]
    steady = squares[:, longest].sum() - stretch / 2 * numbers[:, longest].sum()
    grown = 2 * (1 << longest) * ((interval - loss) ** 2 * numbers[:, longest]).sum()
    noise, error = max(float(steady / grown), 2e-5), float("inf")
    for _ in range(_ROUNDS):
        off, slope = _moments(
            interval, squares=squares, numbers=numbers, usable=usable, noise=noise, loss=loss, stretch=stretch
        )
        kept = _informative(off, slope)
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
    """Return what sums of squares exceed the law by, (pixels, lags), and the mean rise of the law with v, (lags,)."""
    off, slope = np.empty((interval.size, len(usable))), np.empty(len(usable))
    for at, lag in enumerate(usable):
        law, more = (
            interpolated_variance_to_fit(interval, v, lag=1 << lag, loss=loss, stretch=stretch)
            for v in (noise, 1.02 * noise)
        )
        off[:, at] = squares[:, lag] - numbers[:, lag] * law
        slope[at] = np.mean(numbers[:, lag] * (more - law)) / (0.02 * noise)
    return off, slope


def _informative(off: np.ndarray, slope: np.ndarray) -> list[int]:
    """Return the lags that tell at least a hundredth of what the best one tells."""
    alone = slope**2 / np.maximum(off.var(axis=0), 1e-300)
    return [at for at in range(slope.size) if alone[at] > 0.01 * alone.max()]


@dataclass(frozen=True)
class NoiseOfLevels:
    """The noise of intervals of several levels together.

    value, error : v = 1/θ + σ², and its standard error.
    jitter : of the instant of a reset, readouts, which adds the same variance to short intervals and to long ones; None
        with one level.
    agree : whether the levels have one v, at a significance of 1e-3, with the jitter.
    """

    value: float
    error: float
    jitter: Estimate | None
    agree: bool


def combine_fitted_noise(found: list[tuple[float, float]], lengths: list[float]) -> NoiseOfLevels:
    """Return the noise of several levels from (v, standard error) of each, and the mean intervals (m − ℓ) there.

    A jitter of j readouts makes v at a level v + j²/(m − ℓ)². Where the levels do not show it, it is 0, with a bound.
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
    how = "the noise of short intervals against that of long ones"
    design = np.stack([np.ones(len(known)), 1 / at**2], axis=1) / errors[:, None]
    spread = np.linalg.pinv(design.T @ design)
    both = spread @ design.T @ (values / errors)
    wide = sqrt(spread[1, 1])
    if both[1] > stats.norm.isf(_SIGNIFICANCE / 2) * wide:
        rest = float(((values / errors - design @ both) ** 2).sum())
        agree = len(known) < 3 or stats.chi2.sf(rest, len(known) - 2) > _SIGNIFICANCE
        return NoiseOfLevels(
            float(both[0]), sqrt(spread[0, 0]), root_estimate_of_fit(float(both[1]), wide, how=how), bool(agree)
        )
    agree = stats.chi2.sf(off, len(known) - 1) > _SIGNIFICANCE
    bound = Estimate(0.0, 0.0, sqrt(max(both[1] + NORMAL_95 * wide, 0.0)), how)
    return NoiseOfLevels(value, error if agree else error * sqrt(off / (len(known) - 1)), bound, bool(agree))
