"""Confidence intervals of rates, medians, means and differences, and a test of many differences at once.

The unit is the scene: the sequences of a scene share its content, so their outcomes are correlated. Each quantity has
its own kind of interval, because no single method has the right coverage for all of them at twenty scenes.
docs/truth-and-ranking.md gives the coverage, as simulated by ``studies/ranking/interval_coverage.py``.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
from scipy.special import betaincinv, gammaln, stdtrit  # scipy.stats takes half a second to load

from saf_gen.core.seeds import make_generator

CONFIDENCE = 0.95
MIN_SCENES = 3
"""Smallest number of scenes for an interval; the spread of two scenes carries almost no information."""
FINE, COARSE = (256, 32), (128, 16)
"""Grids on which a posterior is evaluated: numbers of cells of the rate, and of the correlation within a scene."""
_MAX_COUNT = 128
"""Number of steps to which the rate of a scene with more sequences is rounded; far finer than its uncertainty."""
_MAX_NUMBERS = 4_000_000

Interval = tuple[float, float]


def rate_intervals(
    fractions: np.ndarray, counts: np.ndarray, *, confidence: float = CONFIDENCE, cells: tuple[int, int] = FINE
) -> np.ndarray:
    """Return the confidence intervals of mean rates over scenes, such as success rates.

    The successes of a scene are modelled as beta-binomial: each scene has its own rate, so its sequences have the
    correlation ρ. The result is the equal-tailed interval of the posterior of the mean rate. The mean has Jeffreys'
    prior, Beta(½, ½) [1]_. ρ has the same prior and is integrated out, because a few scenes do not determine it. The
    interval reaches 1 if all sequences succeeded and 0 if none did, but never shrinks to a point. It contains the mean
    of the fractions.

    Parameters
    ----------
    fractions : ndarray of float, shape (R, S)
        Fraction of successes in each scene, 0 to 1; a draw counts as half a success.
    counts : ndarray of int, shape (S,)
        Number of sequences in each scene, at least 1.
    confidence : float, optional
        Fraction of cases, 0 to 1, in which the interval should contain the mean rate of all scenes of this kind.
    cells : tuple of (int, int), optional
        Numbers of cells of the grid, such as FINE or COARSE.

    Returns
    -------
    ndarray of float64, shape (R, 2)
        Lower and upper ends, 0 to 1.

    References
    ----------
    .. [1] Brown, Cai, DasGupta, "Interval estimation for a binomial proportion", Statistical Science 16(2), 2001,
       doi:10.1214/ss/1009213286; the model: Crowder, "Beta-binomial Anova for proportions", Applied Statistics 27(1),
       1978, doi:10.2307/2346223.
    """
    ends = _find_posterior_intervals(fractions, counts, confidence=confidence, cells=cells)
    # The model takes the rate of a scene to be independent of its number of sequences, and weights scenes by what they
    # tell; the mean weights all alike. If large scenes are easier or harder than small ones, the mean can lie beyond an
    # end of the posterior, which then says nothing against the mean: the interval reaches to it.
    means = np.clip(fractions, 0, 1).mean(axis=1)
    return np.stack([np.minimum(ends[:, 0], means), np.maximum(ends[:, 1], means)], axis=1)


def _find_posterior_intervals(
    fractions: np.ndarray, counts: np.ndarray, *, confidence: float, cells: tuple[int, int]
) -> np.ndarray:
    """Return the equal-tailed intervals of the posterior of rate_intervals: (R, 2)."""
    fractions = np.asarray(fractions, dtype=np.float64)
    steps = np.minimum(counts, _MAX_COUNT)
    # Sums of weights differ in the last bit; without the outer rounding, equal fractions would count as different.
    outcomes = np.stack(
        [np.broadcast_to(counts, fractions.shape), np.round(np.round(fractions * steps, 6) / steps, 9)], -1
    )
    distinct, which = np.unique(outcomes.reshape(-1, 2), axis=0, return_inverse=True)
    likelihoods = _tabulate_likelihoods(distinct[:, 0], distinct[:, 1], cells=cells)
    rows, tail, ends = len(fractions), (1 - confidence) / 2, np.empty((len(fractions), 2))
    at_once = max(1, _MAX_NUMBERS // (cells[0] * cells[1] + len(distinct)))
    for first in range(0, rows, at_once):
        batch = which.reshape(fractions.shape)[first : first + at_once]
        often = np.zeros((len(batch), len(distinct)))
        np.add.at(often, (np.arange(len(batch))[:, None], batch), 1)
        log_posterior = often @ likelihoods
        log_posterior -= log_posterior.max(axis=1, keepdims=True)
        marginal = np.exp(log_posterior, out=log_posterior).reshape(-1, *cells).sum(axis=2)
        below = np.cumsum(marginal, axis=1) / marginal.sum(axis=1, keepdims=True)
        for side, level in enumerate((tail, 1 - tail)):
            ends[first : first + len(batch), side] = _invert(below, level)
    rounded = np.round(fractions, 9)  # the weights of a scene that is always right may sum to slightly less than 1
    ends[(rounded <= 0).all(axis=1), 0] = 0
    ends[(rounded >= 1).all(axis=1), 1] = 1
    return ends


def difference_intervals(
    wins: np.ndarray,
    losses: np.ndarray,
    *,
    counts: np.ndarray,
    confidence: float = CONFIDENCE,
    cells: tuple[int, int] = FINE,
) -> np.ndarray:
    """Return the confidence intervals of the difference of two success rates on the same sequences.

    The difference is the rate of sequences that only the first method solves minus the rate of those that only the
    second solves. Each rate has an interval by rate_intervals. The distances of its ends from the
    estimate are combined like standard deviations, with the correlation over scenes (method of variance estimates
    recovery [1]_).

    Parameters
    ----------
    wins, losses : ndarray of float, shape (R, S)
        Fraction of the sequences of each scene that only the first method, or only the second one, solves, 0 to 1.
    counts : ndarray of int, shape (S,)
        Number of sequences in each scene, at least 1.
    confidence, cells : optional
        See rate_intervals.

    Returns
    -------
    ndarray of float64, shape (R, 2)
        Lower and upper ends, −1 to 1.

    References
    ----------
    .. [1] Newcombe, "Improved confidence intervals for the difference between binomial proportions based on paired
       data", Statistics in Medicine 17(22), 1998,
       doi:10.1002/(SICI)1097-0258(19981130)17:22<2635::AID-SIM954>3.0.CO;2-C.
    """
    first, second = wins.mean(axis=1), losses.mean(axis=1)
    ends = _find_posterior_intervals(np.concatenate([wins, losses]), counts, confidence=confidence, cells=cells)
    below = np.abs(np.stack([first, second]) - ends[:, 0].reshape(2, -1))
    above = np.abs(ends[:, 1].reshape(2, -1) - np.stack([first, second]))
    spread = wins.std(axis=1) * losses.std(axis=1)
    product = ((wins - first[:, None]) * (losses - second[:, None])).mean(axis=1)
    correlation = np.divide(product, spread, out=np.zeros_like(product), where=spread > 0)
    reach = [
        np.sqrt(np.maximum(a**2 + b**2 - 2 * correlation * a * b, 0))
        for a, b in ((below[0], above[1]), (above[0], below[1]))
    ]
    difference = first - second
    return np.clip(np.stack([difference - reach[0], difference + reach[1]], axis=1), -1, 1)


def mean_interval(values: Sequence[float], *, confidence: float = CONFIDENCE) -> Interval | None:
    """Return the interval of the mean over scenes by Student's t, or None for fewer than MIN_SCENES values."""
    if len(values) < MIN_SCENES:
        return None
    half = stdtrit(len(values) - 1, (1 + confidence) / 2) * np.std(values, ddof=1) / np.sqrt(len(values))
    return float(np.mean(values) - half), float(np.mean(values) + half)


def median_interval(values: np.ndarray, scenes: np.ndarray, *, confidence: float = CONFIDENCE) -> Interval | None:
    """Return the confidence interval of the median of values from several scenes.

    The fraction of values up to the median is a ratio of two sums over scenes, because the number of values per scene
    varies too. Its variance over scenes and Student's t give an interval around 0.5. The quantiles of the values at the
    ends of this interval are the ends of the interval of the median (Woodruff [1]_). It contains the sample median.

    Parameters
    ----------
    values : ndarray of float, shape (N,)
        Values, such as absolute errors.
    scenes : ndarray of int, shape (N,)
        Number of the scene of each value.
    confidence : float, optional
        Fraction of cases, above 0 and below 1, in which the interval should contain the median over all scenes of this
        kind.

    Returns
    -------
    tuple of (float, float) or None
        None for fewer than MIN_SCENES scenes, or if the values do not bound the median at this confidence.

    References
    ----------
    .. [1] Woodruff, "Confidence intervals for medians and other position measures", JASA 47, 1952,
       doi:10.1080/01621459.1952.10483443.
    """
    count = len(np.unique(scenes))
    if count < MIN_SCENES:
        return None
    ordered, number = np.sort(values), len(values)
    sums = np.bincount(scenes, (values <= np.median(values)) - 0.5)
    if not sums.any():
        return _invert_tests_of_median(values, scenes, confidence=confidence)
    error = np.sqrt(count / (count - 1) * (sums**2).sum()) / number
    half = stdtrit(count - 1, (1 + confidence) / 2) * error
    # The small subtraction makes a fraction of exactly 1 end at the largest value instead of beyond it.
    low, high = int(np.floor((0.5 - half) * number)), int(np.ceil((0.5 + half) * number - 1e-9)) - 1
    return (float(ordered[low]), float(ordered[high])) if low >= 0 and high < number else None


def _invert_tests_of_median(values: np.ndarray, scenes: np.ndarray, *, confidence: float) -> Interval | None:
    """Return the interval of the median of values of which every scene has exactly half up to the sample median.

    Returns None if the tests do not bound the median; at 95 %, they never do for six scenes or fewer.
    """
    # Woodruff's interval holds the candidates for the median that a test of the fraction of values up to them does not
    # reject, all with the variance of this fraction at the sample median. Here that variance is 0, by the luck of few
    # sequences or because every scene is hard under half of the lights. It would reject every other candidate, and its
    # ranks, counted inwards from the rejected candidates, even cross: low > high. So each candidate, between two values
    # or beyond all, is tested with its own variance. The sample median has no deviation that a test could reject.
    order, count = np.argsort(values), len(np.unique(scenes))
    ordered = values[order]
    of_scene = scenes[order][:, None] == np.unique(scenes)
    up_to = np.concatenate([np.zeros((1, count)), np.cumsum(of_scene, axis=0)])  # (N + 1, S), by candidate
    sums = up_to - up_to[-1] / 2
    limit = stdtrit(count - 1, (1 + confidence) / 2) * np.sqrt(count / (count - 1) * (sums**2).sum(axis=1))
    is_accepted = np.abs(sums.sum(axis=1)) <= limit
    is_accepted[1:-1] &= ordered[:-1] < ordered[1:]  # no candidate lies between equal values
    low, high = np.flatnonzero(is_accepted)[[0, -1]]
    return (float(ordered[low - 1]), float(ordered[high])) if low > 0 and high < len(values) else None


@cache
def _lay_grid(cells: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return both parameters of the beta distribution in every cell (rate, correlation) of the grid, flattened.

    The cells are evenly spaced in the cumulative probability of the priors, so all have equal weight.
    """
    rate, correlation = (betaincinv(0.5, 0.5, (np.arange(number) + 0.5) / number) for number in cells)
    size = 1 / correlation - 1
    return np.outer(rate, size).ravel(), np.outer(1 - rate, size).ravel()


def _tabulate_likelihoods(counts: np.ndarray, fractions: np.ndarray, *, cells: tuple[int, int]) -> np.ndarray:
    """Return the beta-binomial log-likelihoods of U outcomes, up to a constant, in every cell: (U, cells)."""
    a, b = _lay_grid(cells)
    normalisation = {n: gammaln(a + b) - gammaln(a) - gammaln(b) - gammaln(a + b + n) for n in np.unique(counts)}
    return np.stack(
        [
            gammaln(a + n * x) + gammaln(b + n * (1 - x)) + normalisation[n]
            for n, x in zip(counts, fractions, strict=True)
        ]
    )


def _invert(below: np.ndarray, level: float) -> np.ndarray:
    """Return the quantiles at ``level`` of posteriors with cumulative probabilities ``below`` (R, G) at cell ends."""
    rows, cells = np.arange(len(below)), below.shape[1]
    at = np.minimum((below < level).sum(axis=1), cells - 1)
    before = np.where(at > 0, below[rows, at - 1], 0)
    inside = (level - before) / np.maximum(below[rows, at] - before, 1e-300)
    return np.asarray(np.sin((at + inside) / cells * np.pi / 2) ** 2)  # quantile of Beta(½, ½)


MAX_SIGN_PATTERNS = 4096
"""Largest number of patterns of signs; up to 13 scenes, all patterns are used."""
_MAX_SIGNED = 8_000_000


def adjust_p_values(differences: np.ndarray) -> np.ndarray:
    """Return the p-values of the mean differences of many pairs of methods, adjusted for the number of pairs.

    If two methods are equally good, their difference on a scene could equally well have had the opposite sign. The
    signs of all differences are therefore flipped at random, scene by scene and alike for all pairs of methods. The
    standardised difference of each pair is compared with the largest one of all pairs after flipping (single-step max-T
    of Westfall and Young). The test is valid for any number of pairs and any dependence between them, and exact for
    symmetric differences. With five scenes or fewer nothing can be told apart: two of the 2⁵ patterns of signs always
    give the largest sum.

    Parameters
    ----------
    differences : ndarray of float, shape (P, S)
        Difference of each pair of methods on each scene.

    Returns
    -------
    ndarray of float, shape (P,)
        Adjusted p-values, 0 to 1.

    References
    ----------
    .. [1] Westfall, Young, Resampling-Based Multiple Testing, Wiley 1993; signs of clusters: Cameron, Gelbach, Miller,
       "Bootstrap-based improvements for inference with clustered errors", Review of Economics and Statistics 90(3),
       2008, doi:10.1162/rest.90.3.414.
    """
    pairs, scenes = differences.shape
    if not pairs:
        return np.empty(0)
    sizes = np.sqrt((differences**2).sum(axis=1))
    scaled = differences / np.where(sizes > 0, sizes, 1)[:, None]
    signs = _make_sign_patterns(scenes)
    largest = np.zeros(len(signs))
    at_once = max(1, _MAX_SIGNED // len(signs))
    for first in range(0, pairs, at_once):
        np.maximum(largest, np.abs(signs @ scaled[first : first + at_once].T).max(axis=1), out=largest)
    largest.sort()
    found = np.abs(scaled.sum(axis=1))
    return np.asarray(1 - np.searchsorted(largest, found - 1e-9) / len(signs))


def _make_sign_patterns(scenes: int) -> np.ndarray:
    """Return patterns of signs of the scenes, float (T, S).

    The first scene always has +1, because flipping all signs does not change the size of a sum. If there are at most
    MAX_SIGN_PATTERNS patterns, all are returned. Otherwise that many random patterns are returned, the first of which
    flips nothing (random stream ``("statistics", "signs", scenes)``).
    """
    if 2 ** (scenes - 1) <= MAX_SIGN_PATTERNS:
        bits = np.arange(2 ** (scenes - 1))[:, None] >> np.arange(scenes - 1) & 1
    else:
        bits = make_generator("statistics", "signs", scenes).integers(0, 2, (MAX_SIGN_PATTERNS, scenes - 1))
        bits[0] = 0
    return np.concatenate([np.ones((len(bits), 1)), 1 - 2 * bits.astype(np.float64)], axis=1)
