"""A law with its checks and figures: what is compared, with which 95 % interval, and how far it may be off.

A law must neither fail by chance nor hold because its tolerance is wide. Therefore all its figures together fail
correct code with the probability :data:`FALSE_ALARM` (Bonferroni: each of n figures gets 1/n of it), and the tolerance
follows from the scatter of the workload alone, plus the known error of the law itself as ``model_error``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.special import gammaincinv, ndtri, stdtrit

from saf_gen.errors import SafGenError

if TYPE_CHECKING:
    from studies.laws.workload import DatasetMaker

FALSE_ALARM = 1e-4
"""Probability that a check fails although all its laws hold."""


class Skipped(SafGenError):
    """Raised by a law that cannot be checked here, such as one whose package is not installed; the message says why."""


@dataclass(frozen=True)
class Comparison:
    """One figure of a law, its 95 % interval, and its allowed range.

    Parameters
    ----------
    what : str
        Name of the figure, in a few words.
    measured : float
        Value of the figure in the output of saf_gen.
    expected : float, optional
        Value that the law predicts; NaN, the default, if the law gives only a bound.
    at_least, at_most : float, optional
        Ends of the allowed range, which follow from the statistics of the workload; unbounded by default.
    low, high : float, optional
        Ends of the 95 % interval of ``measured``; NaN, the default, for a figure without scatter.
    unit : str, optional
        Unit of the figure; '', the default, for a dimensionless number.
    """

    what: str
    measured: float
    expected: float = math.nan
    at_least: float = -math.inf
    at_most: float = math.inf
    low: float = math.nan
    high: float = math.nan
    unit: str = ""

    @property
    def passed(self) -> bool:
        """True if the figure is within the allowed range; a NaN never is."""
        return self.at_least <= self.measured <= self.at_most

    @property
    def tolerance_used(self) -> float:
        """Fraction of the tolerance that the figure uses; above 1 the figure fails.

        This is the deviation from the expected value, divided by the allowed deviation. Without an expected value, it
        is the figure divided by its upper bound, or its lower bound divided by the figure. A NaN uses infinitely much.
        """
        if math.isnan(self.measured):
            return math.inf
        if math.isfinite(self.expected):
            off = self.measured - self.expected
            allowed = self.at_most - self.expected if off > 0 else self.expected - self.at_least
            return abs(off) / allowed if allowed > 0 else (0.0 if off == 0 else math.inf)
        if math.isfinite(self.at_most) and self.at_most > 0:
            return self.measured / self.at_most
        if math.isfinite(self.at_least) and self.measured > 0:
            return self.at_least / self.measured
        return 0.0 if self.passed else math.inf


@dataclass(frozen=True)
class Curve:
    """A curve of a plot. All its sequences have the same length, or are empty.

    A ``line`` is a law that holds between its values, too; ``marks`` are a law at single places, such as whole numbers;
    ``points`` are what was measured, with error bars.
    """

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    kind: Literal["line", "marks", "points"] = "line"
    error: tuple[float, ...] = ()


@dataclass(frozen=True)
class Plot:
    """The data of the plot of a law; with ``names``, the horizontal axis names things, and x counts them from 0."""

    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    log_x: bool = False
    log_y: bool = False
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Finding:
    """What a check found: its figures, its plot, remarks in plain sentences, and why it could not be completed.

    ``reason`` is empty for a check that came to its end; ``skipped`` says that it was not begun, because something that
    it needs is missing here.
    """

    comparisons: tuple[Comparison, ...]
    plot: Plot | None = None
    remarks: tuple[str, ...] = ()
    reason: str = ""
    skipped: bool = False

    @property
    def outcome(self) -> Literal["passed", "failed", "skipped", "broken"]:
        """``passed`` if there are figures and all are within their tolerance; ``broken`` if an error stopped it."""
        if self.reason:
            return "skipped" if self.skipped else "broken"
        return "passed" if self.comparisons and all(one.passed for one in self.comparisons) else "failed"

    @property
    def tolerance_used(self) -> float:
        """The largest fraction of its tolerance that a figure uses, infinite for a NaN; NaN without figures."""
        return max((one.tolerance_used for one in self.comparisons), default=math.nan)


@dataclass(frozen=True)
class Law:
    """One law that the output of saf_gen must obey.

    Parameters
    ----------
    name : str
        Name of the law for ``--only``; it begins with the subject.
    law : str
        The law in one sentence.
    formula : str
        The law as a formula.
    source : str
        Origin of the law, with its DOI if it has one.
    workload : str
        Description of what is generated.
    tolerance : str
        The allowed deviation, and the reason for it.
    check : callable
        Function of a DatasetMaker and a bool (True for the small size) that generates the streams and returns the
        Finding.
    """

    name: str
    law: str
    formula: str
    source: str
    workload: str
    tolerance: str
    check: Callable[[DatasetMaker, bool], Finding]

    @property
    def subject(self) -> str:
        """Subject of the law: the first word of its name."""
        return self.name.partition("_")[0]


def deviations(probability: float, *, freedom: float = math.inf) -> float:
    """Return the upper limit, in standard errors, that the error of an estimate exceeds with a given probability.

    The distribution is Student's t, or the normal distribution if ``freedom`` is infinite. The functions behind
    ``scipy.stats`` are called directly, because importing ``scipy.stats`` takes longer than running a check.
    """
    return -float(ndtri(probability) if math.isinf(freedom) else stdtrit(freedom, probability))


def _chi_squared(probabilities: tuple[float, float], *, freedom: int) -> np.ndarray:
    """Return quantiles of χ² divided by its degrees of freedom."""
    return np.asarray(2 * gammaincinv(freedom / 2, probabilities) / freedom)


def compare_estimate(
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

    ``figures`` is the number of figures of the law; ``model_error`` is the known error of the law, in the figure's
    unit.
    """
    allowed = deviations(FALSE_ALARM / (2 * figures)) * standard_error + model_error
    half = deviations(0.025) * standard_error
    return _around(what, float(measured), expected=float(expected), allowed=allowed, half=half, unit=unit)


def compare_mean(
    what: str,
    samples: np.ndarray,
    *,
    expected: float,
    figures: int,
    model_error: float = 0.0,
    least_scatter: float = 0.0,
    unit: str = "",
) -> Comparison:
    """Return the comparison of the mean of independent samples with the value that a law predicts.

    The scatter of the samples gives the standard error of the mean, but no less than ``least_scatter``: a few counts of
    whole spikes may happen to be equal. The bounds are those of Student's t distribution, because the scatter of few
    samples is itself uncertain. Other arguments are those of :func:`compare_estimate`.
    """
    samples = np.asarray(samples, np.float64).ravel()
    error = max(float(samples.std(ddof=1)), least_scatter) / math.sqrt(samples.size)
    mean, freedom = float(samples.mean()), samples.size - 1
    allowed = deviations(FALSE_ALARM / (2 * figures), freedom=freedom) * error + model_error
    half = deviations(0.025, freedom=freedom) * error
    return _around(what, mean, expected=expected, allowed=allowed, half=half, unit=unit)


def _around(what: str, measured: float, *, expected: float, allowed: float, half: float, unit: str) -> Comparison:
    ends = expected - allowed, expected + allowed
    return Comparison(what, measured, expected, *ends, measured - half, measured + half, unit)


def compare_chi_squared(what: str, chi_squared: float, *, freedom: int, figures: int) -> Comparison:
    """Return the comparison of χ² per degree of freedom with 1; a fit that is too good fails as well."""
    ends = _chi_squared((FALSE_ALARM / (2 * figures), 1 - FALSE_ALARM / (2 * figures)), freedom=freedom)
    ratio = chi_squared / freedom
    spread = _chi_squared((0.025, 0.975), freedom=freedom)  # the scatter that the law predicts
    return Comparison(what, ratio, 1.0, float(ends[0]), float(ends[1]), ratio - 1 + spread[0], ratio - 1 + spread[1])
