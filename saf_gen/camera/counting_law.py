"""Exact distribution of spike counts and of intervals between spikes.

A pixel fires each time its charge has grown by another threshold, and the spike is assigned to the readout in which
that happens. A continuous quantity X is thus observed as an integer, with a phase u that is uniform over 0 to 1:

    N = ⌊X + u⌋        counts: X is the charge of a window in thresholds; intervals: X is an interval in readouts

Given X, N is one of the two nearest integers, with the mean X and the variance f(1 − f), where f is the fractional part
of X. Its Fourier series is f(1 − f) = 1/6 − π⁻² Σₖ cos(2πkX)/k², k = 1, 2, …. For a normal X with mean m and variance
s², the mean of cos(2πkX) is cos(2πkm)·exp(−2π²k²s²), and therefore

    Var N = s² + 1/6 − π⁻² Σₖ cos(2πkm)·exp(−2π²k²s²)/k²

With θ electrons per spike and a threshold noise σ relative to θ, an interval of m readouts has s² = (1/θ + σ²)·m², the
noise of one threshold, and a window of m thresholds has s² = (1/θ + σ²)·m, the noise of m thresholds. The average of
Var N over m, and its limit for large s, is s² + 1/6; if s exceeds 1/2, the difference is below 10⁻³.

References
----------
D. R. Cox, Renewal Theory, 1962 (counting from a uniform phase); https://dlmf.nist.gov/24.8.E1 (the series, which is
that of the Bernoulli polynomial B₂ = 1/6 − f(1 − f)).
"""

import numpy as np
from scipy import stats

from saf_gen.camera.sensor import Sensor

TERMS = 4000
"""Limit of the number of terms; the truncation error is below 1/(π²·TERMS) = 2.5·10⁻⁵, and 0 if s exceeds 0.0004."""


def noise_per_spike(sensor: Sensor, *, rate: float = 0.0) -> float:
    """Return 1/θ + σ², the relative variance of the charge of one interval, from the noise that is switched on.

    A reset jitter of j readouts adds (j·rate)², that is, j² to the variance of an interval in readouts at any rate.
    """
    shot = 1 / sensor.threshold_e if sensor.noise.shot else 0.0
    threshold = sensor.threshold_noise_rms**2 if sensor.noise.threshold_noise else 0.0
    return shot + threshold + (sensor.reset_jitter * sensor.noise.reset_jitter * rate) ** 2


def count_oscillation(mean: np.ndarray | float, variance: np.ndarray | float) -> np.ndarray:
    """Return π⁻² Σₖ cos(2πkm)·exp(−2π²k²s²)/k², the oscillating term of Var N, −1/12 to 1/6, with average 0 over m.

    ``mean`` m and ``variance`` s² of X are numbers or arrays that broadcast.
    """
    mean, variance = np.broadcast_arrays(np.asarray(mean, np.float64), np.asarray(variance, np.float64))
    out = np.zeros(mean.shape)
    smallest = float(variance.min(initial=np.inf))
    last = TERMS if smallest <= 0 else min(TERMS, int(np.sqrt(40 / (2 * np.pi**2 * smallest))) + 1)
    for k in range(1, last + 1):
        out += np.cos(2 * np.pi * k * mean) * np.exp(-2 * (np.pi * k) ** 2 * variance) / k**2
    return out / np.pi**2


def count_variance(mean: np.ndarray | float, variance: np.ndarray | float) -> np.ndarray:
    """Return the variance of the integer N if the quantity X that it counts is normal with this mean and variance."""
    return np.asarray(variance) + 1 / 6 - count_oscillation(mean, variance)


def count_probabilities(mean: float, variance: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the integers that a count N can be and the probability of each, if X is normal with a positive variance.

    P(N = n) is the mean of max(0, 1 − |X − n|), which is the second difference of G(x), the mean of max(0, x − X).
    """
    sd = np.sqrt(variance)
    n = np.arange(int(np.floor(mean - 9 * sd)) - 1, int(np.ceil(mean + 9 * sd)) + 2)
    z = (np.arange(n[0] - 1, n[-1] + 2) - mean) / sd
    g = sd * (z * stats.norm.cdf(z) + stats.norm.pdf(z))
    return n, np.maximum(np.diff(g, 2), 0)


def count_chi_squared(seen: np.ndarray, law: tuple[np.ndarray, np.ndarray]) -> tuple[float, int]:
    """Return Pearson's χ² of observed integers against a law, and its degrees of freedom.

    Cells with an expected count below 10 are merged into one, which is merged into its neighbour if it still expects
    fewer than 10.

    Parameters
    ----------
    seen : ndarray of int, any shape
        Observed numbers. Numbers outside the range of the law are counted at its ends.
    law : tuple of ndarray, shapes (n,) and (n,)
        Consecutive integers and the probability of each, as :func:`count_probabilities` returns them.
    """
    numbers, probabilities = law
    seen = np.asarray(seen).ravel()
    found = np.bincount(np.clip(seen, numbers[0], numbers[-1]) - numbers[0], minlength=numbers.size)
    common = probabilities * seen.size >= 10
    expected = np.append(probabilities[common], 1 - probabilities[common].sum()) * seen.size
    found = np.append(found[common], found[~common].sum())
    if expected[-1] < 10:  # the merged rest is too rare to be a cell
        expected[-2], found[-2] = expected[-2:].sum(), found[-2:].sum()
        expected, found = expected[:-1], found[:-1]
    return float(((found - expected) ** 2 / expected).sum()), expected.size - 1


def count_deviations(seen: np.ndarray, mean: float, *, variance: float) -> float:
    """Return by how many standard deviations the variance of the integers ``seen`` exceeds the exact law of counting.

    The variance of ``seen`` is taken about the mean of the law; the variance of this estimate is (μ₄ − μ₂²)/n,
    with the moments of the law.
    """
    n, p = count_probabilities(mean, variance)
    expected = count_variance(mean, variance)
    fourth = (p * (n - mean) ** 4).sum()
    return float((np.mean((seen - mean) ** 2) - expected) / np.sqrt((fourth - expected**2) / np.size(seen)))
