"""From samples to comparisons: 95 % intervals, and how far a figure may lie from its law.

A check must not fail by chance, and must not pass by width. So all its figures together fail a product that obeys the
law with the probability :data:`FALSE_ALARM` (Bonferroni: each of n figures with a part of 1/n), and what is allowed
follows from the scatter of the workload alone, with whatever the law itself leaves out added as ``model_error``.
"""

import math

import numpy as np
from scipy.special import gammaincinv, ndtri, stdtrit

from saf_gen.acceptance.validation.check import Comparison

FALSE_ALARM = 1e-4
"""Probability that a check fails although every law of it holds."""


def deviations_by_law(probability: float, *, freedom: float = math.inf) -> float:
    """Return how many standard errors are exceeded with a probability, upwards: by Student's law, or the normal one.

    Straight from the functions behind ``scipy.stats``, which alone takes longer to import than a check to run.
    """
    return -float(ndtri(probability) if math.isinf(freedom) else stdtrit(freedom, probability))


def _chi_squared_by_law(probabilities: tuple[float, float], *, freedom: int) -> np.ndarray:
    """Return the quantiles of χ² over its degrees of freedom."""
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
    """Return the comparison of an estimate of known standard error with what a law expects.

    ``figures`` is the number of figures of the check; ``model_error`` what the law leaves out, in the figure's unit.
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
    """Return the comparison of the mean of independent samples, whose own scatter gives its standard error.

    From few samples that scatter is itself uncertain: the bounds are Student's t.
    """
    samples = np.asarray(samples, np.float64).ravel()
    error = float(samples.std(ddof=1) / math.sqrt(samples.size))
    mean, freedom = float(samples.mean()), samples.size - 1
    allowed = deviations_by_law(FALSE_ALARM / (2 * figures), freedom=freedom) * error + model_error
    half = deviations_by_law(0.025, freedom=freedom) * error
    return Comparison(what, mean, expected, expected - allowed, expected + allowed, mean - half, mean + half, unit)


def compare_chi_squared_with_law(what: str, chi_squared: float, *, freedom: int, figures: int) -> Comparison:
    """Return the comparison of χ² over its degrees of freedom with 1; too good a fit is refused as well."""
    ends = _chi_squared_by_law((FALSE_ALARM / (2 * figures), 1 - FALSE_ALARM / (2 * figures)), freedom=freedom)
    ratio = chi_squared / freedom
    spread = _chi_squared_by_law((0.025, 0.975), freedom=freedom)  # the law's own scatter
    return Comparison(what, ratio, 1.0, float(ends[0]), float(ends[1]), ratio - 1 + spread[0], ratio - 1 + spread[1])
