"""How counts of spikes, and intervals between them, are distributed: the exact law.

A pixel fires whenever its charge has grown by one more threshold, and a spike belongs to the readout in which that
happens. So a number of whole units is seen of something continuous, from a phase u that is spread evenly over the unit:

    N = ⌊X + u⌋        counts: X is the charge of a window in thresholds; intervals: X is an interval in readouts

Given X, N is one of the two whole numbers beside it, with mean X and variance f(1 − f), f the fraction of X. As a
Fourier series that is f(1 − f) = 1/6 − π⁻² Σₖ cos(2πkX)/k², k = 1, 2, …. With X normal, of mean m and variance s², the
mean of cos(2πkX) is cos(2πkm)·exp(−2π²k²s²), so

    Var N = s² + 1/6 − π⁻² Σₖ cos(2πkm)·exp(−2π²k²s²)/k²

With θ electrons a spike and a threshold noise of σ, relative to θ, an interval has s² = (1/θ + σ²)·m², the noise of one
threshold, and a window of m thresholds has s² = (1/θ + σ²)·m, that of m of them. s² + 1/6 is the average over m, and
the limit for large s: beyond 1/2 it is within 10⁻³.

Counting from an even phase: D. R. Cox, Renewal Theory, 1962. The series, that of the Bernoulli polynomial B₂ = 1/6 −
f(1 − f): https://dlmf.nist.gov/24.8.E1.
"""

import numpy as np
from scipy import stats

from saf_gen.camera.sensor import Sensor

TERMS = 4000
"""Terms of the series; what is left out is below 1/(π²·TERMS) = 2.5·10⁻⁵, and nothing where s exceeds 0.0004."""


def pixel_noise_per_spike(sensor: Sensor, *, rate: float = 0.0) -> float:
    """Return 1/θ + σ², the relative variance of the charge of one interval, of the noise that is switched on.

    A reset that jitters by j readouts adds (j·rate)²: j² to the variance of an interval in readouts, at any rate.
    """
    shot = 1 / sensor.threshold_e if sensor.noise.shot else 0.0
    threshold = sensor.threshold_noise_rms**2 if sensor.noise.threshold_noise else 0.0
    return shot + threshold + (sensor.reset_jitter * sensor.noise.reset_jitter * rate) ** 2


def pixel_count_oscillation(mean: np.ndarray | float, variance: np.ndarray | float) -> np.ndarray:
    """Return the last term of the law, from −1/12 to 1/6: what the average over ``mean`` does not know.

    ``mean`` and ``variance`` are those of X, numbers or arrays that fit each other.
    """
    mean, variance = np.broadcast_arrays(np.asarray(mean, np.float64), np.asarray(variance, np.float64))
    out = np.zeros(mean.shape)
    smallest = float(variance.min(initial=np.inf))
    last = TERMS if smallest <= 0 else min(TERMS, int(np.sqrt(40 / (2 * np.pi**2 * smallest))) + 1)
    for k in range(1, last + 1):
        out += np.cos(2 * np.pi * k * mean) * np.exp(-2 * (np.pi * k) ** 2 * variance) / k**2
    return out / np.pi**2


def pixel_count_variance(mean: np.ndarray | float, variance: np.ndarray | float) -> np.ndarray:
    """Return the variance of N for X of this mean and variance."""
    return np.asarray(variance) + 1 / 6 - pixel_count_oscillation(mean, variance)


def pixel_count_probabilities(mean: float, variance: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the whole numbers that N may be, and the probability of each, for a normal X of positive variance.

    P(N = n) is the mean of max(0, 1 − |X − n|), a second difference of G(x), the mean of max(0, x − X).
    """
    sd = np.sqrt(variance)
    n = np.arange(int(np.floor(mean - 9 * sd)) - 1, int(np.ceil(mean + 9 * sd)) + 2)
    z = (np.arange(n[0] - 1, n[-1] + 2) - mean) / sd
    g = sd * (z * stats.norm.cdf(z) + stats.norm.pdf(z))
    return n, np.maximum(np.diff(g, 2), 0)


def pixel_count_chi_squared(seen: np.ndarray, law: tuple[np.ndarray, np.ndarray]) -> tuple[float, int]:
    """Return Pearson's χ² of whole numbers against a law, and its degrees of freedom.

    Cells that expect below 10 are merged into one, and that one into its neighbour if it still does.

    Parameters
    ----------
    seen : whole numbers, any shape; what lies beyond the numbers of the law counts at their ends.
    law : consecutive numbers and the probability of each, (n,) and (n,), as :func:`pixel_count_probabilities` returns.
    """
    numbers, probabilities = law
    seen = np.asarray(seen).ravel()
    found = np.bincount(np.clip(seen, numbers[0], numbers[-1]) - numbers[0], minlength=numbers.size)
    common = probabilities * seen.size >= 10
    expected = np.append(probabilities[common], 1 - probabilities[common].sum()) * seen.size
    found = np.append(found[common], found[~common].sum())
    if expected[-1] < 10:  # the rest is too rare to be a cell
        expected[-2], found[-2] = expected[-2:].sum(), found[-2:].sum()
        expected, found = expected[:-1], found[:-1]
    return float(((found - expected) ** 2 / expected).sum()), expected.size - 1


def pixel_count_p_value(seen: np.ndarray, mean: float, *, variance: float) -> float:
    """Return the p value of Pearson's test of whole numbers against the law for X of this mean and variance."""
    return float(stats.chi2.sf(*pixel_count_chi_squared(seen, pixel_count_probabilities(mean, variance))))


def pixel_count_deviations(seen: np.ndarray, mean: float, *, variance: float) -> float:
    """Return how far the variance of ``seen`` about the law's mean lies from the law's, in its standard deviations.

    The variance of such a mean of squares is (μ₄ − μ₂²)/n, with the law's own moments.
    """
    n, p = pixel_count_probabilities(mean, variance)
    expected = pixel_count_variance(mean, variance)
    fourth = (p * (n - mean) ** 4).sum()
    return float((np.mean((seen - mean) ** 2) - expected) / np.sqrt((fourth - expected**2) / np.size(seen)))
