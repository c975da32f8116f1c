"""From samples to comparisons: 95 % intervals, and the deviation from its law that a figure is allowed.

A check must neither fail by chance nor pass because its tolerance is wide. Therefore all its figures together fail
correct code with the probability :data:`FALSE_ALARM` (Bonferroni: each of n figures gets 1/n of it), and the tolerance
follows from the scatter of the workload alone, plus the known error of the law itself as ``model_error``.
"""

import math

import numpy as np
from scipy.special import gammaincinv, ndtri, stdtrit

from saf_gen.acceptance.validation.check import Comparison

FALSE_ALARM = 1e-4
"""Probability that a check fails although all its laws hold."""


def deviations_by_law(probability: float, *, freedom: float = math.inf) -> float:
    """Return the upper limit, in standard errors, that the error of an estimate exceeds with a given probability.

    The distribution is Student's t, or the normal distribution if ``freedom`` is infinite. The functions behind
    ``scipy.stats`` are called directly, because importing ``scipy.stats`` takes longer than running a check.
    """
    return -float(ndtri(probability) if math.isinf(freedom) else stdtrit(freedom, probability))


def _chi_squared_by_law(probabilities: tuple[float, float], *, freedom: int) -> np.ndarray:
    """Return quantiles of χ² divided by its degrees of freedom."""
    return np.asarray(2 * gammaincinv(freedom / 2, probabilities) / freedom)


def compare_estimate_with_law(
    what: str,
    measured: float,
    *,
    standard_error: float,
    expected: float,
    figures: int,
    model_error: float = 0.0,
    unit: str = "",
) -> Comparison:
    """Return the comparison of an estimate of known standard error with the value that a law predicts.

    ``figures`` is the number of figures of the check; ``model_error`` is the known error of the law, in the figure's
    unit.
    """
    allowed = deviations_by_law(FALSE_ALARM / (2 * figures)) * standard_error + model_error
    half = deviations_by_law(0.025) * standard_error
    return Comparison(
        what,
        float(measured),
        float(expected),
        expected - allowed,
        expected + allowed,
        measured - half,
        measured + half,
        unit,
    )


def compare_mean_with_law(
    what: str, samples: np.ndarray, *, expected: float, figures: int, model_error: float = 0.0, unit: str = ""
) -> Comparison:
    """Return the comparison of the mean of independent samples with the value that a law predicts.

    The scatter of the samples gives the standard error of the mean. The bounds are those of Student's t distribution,
    because the scatter of few samples is itself uncertain. Other arguments are those of
    :func:`compare_estimate_with_law`.
    """
    samples = np.asarray(samples, np.float64).ravel()
    error = float(samples.std(ddof=1) / math.sqrt(samples.size))
    mean, freedom = float(samples.mean()), samples.size - 1
    allowed = deviations_by_law(FALSE_ALARM / (2 * figures), freedom=freedom) * error + model_error
    half = deviations_by_law(0.025, freedom=freedom) * error
    return Comparison(what, mean, expected, expected - allowed, expected + allowed, mean - half, mean + half, unit)


def compare_chi_squared_with_law(what: str, chi_squared: float, *, freedom: int, figures: int) -> Comparison:
    """Return the comparison of χ² per degree of freedom with 1; a fit that is too good fails as well."""
    ends = _chi_squared_by_law((FALSE_ALARM / (2 * figures), 1 - FALSE_ALARM / (2 * figures)), freedom=freedom)
    ratio = chi_squared / freedom
    spread = _chi_squared_by_law((0.025, 0.975), freedom=freedom)  # the scatter that the law predicts
    return Comparison(what, ratio, 1.0, float(ends[0]), float(ends[1]), ratio - 1 + spread[0], ratio - 1 + spread[1])
