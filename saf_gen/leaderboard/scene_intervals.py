"""Confidence intervals of rates, medians, means and differences, from a few scenes with many sequences each.

The scene is the unit: sequences of a scene share its content, so what they say is correlated. Each interval suits its
quantity, because one way does not hold for all at twenty scenes: see docs/explanation/statistics.md for the coverage of
each by simulation, and ``benchmarks/interval_coverage.py`` to repeat it.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
from scipy.special import betaincinv, gammaln, stdtrit  # scipy.stats has the same and takes half a second to load

CONFIDENCE = 0.95
MIN_SCENES = 3
"""Fewest scenes for an interval: the spread of two scenes says next to nothing."""
FINE, COARSE = (256, 32), (128, 16)
"""Cells of the grid on which a posterior is found: of the rate, and of the correlation within a scene."""
_MAX_COUNT = 128
"""Steps to which the rate of a scene with more sequences is rounded: far finer than what so many sequences tell."""
_MAX_NUMBERS = 4_000_000

Interval = tuple[float, float]


def find_intervals_of_ranked_rate(
    shares: np.ndarray, counts: np.ndarray, *, confidence: float = CONFIDENCE, cells: tuple[int, int] = FINE
) -> np.ndarray:
    """Return the intervals of mean rates over scenes, such as success rates: float64 (R, 2), each within 0...1.

    The successes of a scene are taken as beta-binomial: scenes have rates of their own, so that sequences within one
    correlate by ρ. The interval is equal-tailed, of the posterior of the mean rate, with Jeffreys' prior Beta(½, ½)
    for the mean [1]_ and Beta(½, ½) for ρ, which is integrated over: whoever has seen few scenes does not know ρ. It
    reaches to 1 where all succeeded, and to 0 where none did, and has a width all the same.

    Parameters
    ----------
    shares : float (R, S), 0–1
        Fraction of successes in each scene; a draw counts as half of one.
    counts : int (S,)
        Sequences in each scene, at least 1.
    confidence : 0–1, fraction of cases in which the interval should hold the mean rate of all scenes of this kind.
    cells : of the grid, see FINE.

    References
    ----------
    .. [1] Brown, Cai, DasGupta, "Interval estimation for a binomial proportion", Statistical Science 16(2), 2001,
       doi:10.1214/ss/1009213286; the model: Crowder, "Beta-binomial Anova for proportions", Applied Statistics 27(1),
       1978, doi:10.2307/2346223.
    """
    shares = np.asarray(shares, dtype=np.float64)
    steps = np.minimum(counts, _MAX_COUNT)
    # Sums of weights differ in the last bit: without the outer rounding equal shares would count as different ones.
    outcomes = np.stack([np.broadcast_to(counts, shares.shape), np.round(np.round(shares * steps, 6) / steps, 9)], -1)
    distinct, which = np.unique(outcomes.reshape(-1, 2), axis=0, return_inverse=True)
    likelihoods = _tabulate_likelihoods(distinct[:, 0], distinct[:, 1], cells=cells)
    rows, tail, ends = len(shares), (1 - confidence) / 2, np.empty((len(shares), 2))
    at_once = max(1, _MAX_NUMBERS // (cells[0] * cells[1] + len(distinct)))
    for first in range(0, rows, at_once):
        own = which.reshape(shares.shape)[first : first + at_once]
        often = np.zeros((len(own), len(distinct)))
        np.add.at(often, (np.arange(len(own))[:, None], own), 1)
        log_posterior = often @ likelihoods
        log_posterior -= log_posterior.max(axis=1, keepdims=True)
        marginal = np.exp(log_posterior, out=log_posterior).reshape(-1, *cells).sum(axis=2)
        below = np.cumsum(marginal, axis=1) / marginal.sum(axis=1, keepdims=True)
        for side, level in enumerate((tail, 1 - tail)):
            ends[first : first + len(own), side] = _invert(below, level)
    ends[(shares <= 0).all(axis=1), 0] = 0
    ends[(shares >= 1).all(axis=1), 1] = 1
    return ends


def find_rank_difference_intervals(
    wins: np.ndarray, losses: np.ndarray, *, counts: np.ndarray, confidence: float = CONFIDENCE,
    cells: tuple[int, int] = FINE,
) -> np.ndarray:  # fmt: skip
    """Return the intervals of differences of two success rates on the same sequences: float64 (R, 2), −1...1.

    The difference is the rate of sequences that only the first solves less that of those that only the second solves.
    Both have an interval by find_intervals_of_ranked_rate, and the distances of its ends from the estimates combine as
    the squares of standard deviations do, with the correlation over scenes (method of variance estimates recovery
    [1]_).

    Parameters
    ----------
    wins, losses : float (R, S), fractions of each scene's sequences that only the first, and only the second, solves.
    counts : int (S,), sequences in each scene.

    References
    ----------
    .. [1] Newcombe, "Improved confidence intervals for the difference between binomial proportions based on paired
       data", Statistics in Medicine 17(22), 1998,
       doi:10.1002/(SICI)1097-0258(19981130)17:22<2635::AID-SIM954>3.0.CO;2-C.
    """
    first, second = wins.mean(axis=1), losses.mean(axis=1)
    ends = find_intervals_of_ranked_rate(np.concatenate([wins, losses]), counts, confidence=confidence, cells=cells)
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


def find_interval_of_ranked_mean(values: Sequence[float], *, confidence: float = CONFIDENCE) -> Interval | None:
    """Return the interval of the mean over scenes by Student's t; None for fewer than MIN_SCENES values."""
    if len(values) < MIN_SCENES:
        return None
    half = stdtrit(len(values) - 1, (1 + confidence) / 2) * np.std(values, ddof=1) / np.sqrt(len(values))
    return float(np.mean(values) - half), float(np.mean(values) + half)


def find_interval_of_ranked_median(
    values: np.ndarray, scenes: np.ndarray, *, confidence: float = CONFIDENCE
) -> Interval | None:
    """Return the interval of the median of values of several scenes; None where the scenes do not bound it.

    The fraction of values up to the median has a variance over scenes (of a ratio, as answers are counted too) and an
    interval by Student's t; the values at the ends of that share are the interval (Woodruff [1]_).

    Parameters
    ----------
    values : float (N,), such as absolute errors.
    scenes : int (N,), the number of each value's scene.

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
    error = np.sqrt(count / (count - 1) * (sums**2).sum()) / number
    half = stdtrit(count - 1, (1 + confidence) / 2) * error
    # Half a value less than nothing: a fraction of exactly 1 is bounded by the largest value.
    low, high = int(np.floor((0.5 - half) * number)), int(np.ceil((0.5 + half) * number - 1e-9)) - 1
    return (float(ordered[low]), float(ordered[high])) if low >= 0 and high < number else None


@cache
def _lay_grid(cells: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return both parameters of the beta law in every cell (rate, correlation), flat.

    Cells lie evenly in the probability of their priors, so that all weigh the same.
    """
    rate, correlation = (betaincinv(0.5, 0.5, (np.arange(number) + 0.5) / number) for number in cells)
    size = 1 / correlation - 1
    return np.outer(rate, size).ravel(), np.outer(1 - rate, size).ravel()


def _tabulate_likelihoods(counts: np.ndarray, shares: np.ndarray, *, cells: tuple[int, int]) -> np.ndarray:
    """Return the logarithms of the beta-binomial likelihoods of U outcomes, but for a constant: (U, cells)."""
    a, b = _lay_grid(cells)
    own = {n: gammaln(a + b) - gammaln(a) - gammaln(b) - gammaln(a + b + n) for n in np.unique(counts)}
    return np.stack(
        [gammaln(a + n * x) + gammaln(b + n * (1 - x)) + own[n] for n, x in zip(counts, shares, strict=True)]
    )


def _invert(below: np.ndarray, level: float) -> np.ndarray:
    """Return the rates up to which a posterior has this probability; ``below`` (R, G) is up to the end of each cell."""
    rows, cells = np.arange(len(below)), below.shape[1]
    at = np.minimum((below < level).sum(axis=1), cells - 1)
    before = np.where(at > 0, below[rows, at - 1], 0)
    inside = (level - before) / np.maximum(below[rows, at] - before, 1e-300)
    return np.asarray(np.sin((at + inside) / cells * np.pi / 2) ** 2)  # of Beta(½, ½)
