"""Checks and their results: the law in words, the figures that were compared with it, and the data of a plot."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

from saf_gen.errors import SafGenError

if TYPE_CHECKING:
    from saf_gen.acceptance.validation.workload import DatasetMaker


class CheckSkipped(SafGenError):
    """Raised by a check that cannot run here, such as one whose package is not installed; the message says why."""


@dataclass(frozen=True)
class Comparison:
    """One figure of a check, its 95 % interval, and its allowed range.

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
        is the figure divided by its upper bound, or its lower bound divided by the figure.
        """
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
    """A curve of a plot: a line, or points with error bars. All its sequences have the same length, or are empty."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    kind: Literal["line", "points"] = "line"
    error: tuple[float, ...] = ()


@dataclass(frozen=True)
class Plot:
    """The data of the plot of a check."""

    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    log_x: bool = False
    log_y: bool = False


@dataclass(frozen=True)
class Finding:
    """The result of a check: its figures, its plot, and remarks in plain sentences."""

    comparisons: tuple[Comparison, ...]
    plot: Plot | None = None
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Check:
    """One law that the output of saf_gen must obey.

    Parameters
    ----------
    name : str
        Name of the check for ``--only``; it begins with the subject.
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
    run : callable
        Function of a DatasetMaker and a bool (True for the small size) that generates the streams and returns the
        Finding.
    """

    name: str
    law: str
    formula: str
    source: str
    workload: str
    tolerance: str
    run: Callable[[DatasetMaker, bool], Finding]

    @property
    def subject(self) -> str:
        """Subject of the check: the first word of its name."""
        return self.name.partition("_")[0]


@dataclass(frozen=True)
class Verdict:
    """The outcome of a check: ``passed``, ``failed``, ``skipped`` or ``broken``, the last two with a reason."""

    name: str
    outcome: Literal["passed", "failed", "skipped", "broken"]
    seconds: float
    comparisons: tuple[Comparison, ...] = ()
    plot: Plot | None = None
    remarks: tuple[str, ...] = ()
    reason: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return the verdict as a dictionary of JSON values; infinities and NaN become None."""
        return _finite(asdict(self))

    @classmethod
    def from_dict(cls, found: dict[str, Any]) -> Verdict:
        """Return the verdict that :meth:`as_dict` has converted to ``found``."""
        plot = found["plot"]
        return cls(
            **found
            | {
                "comparisons": tuple(_comparison(one) for one in found["comparisons"]),
                "plot": plot and Plot(**plot | {"curves": tuple(_curve(one) for one in plot["curves"])}),
                "remarks": tuple(found["remarks"]),
            }
        )


def _comparison(found: dict[str, Any]) -> Comparison:
    missing = {"at_least": -math.inf, "at_most": math.inf}
    numbers: dict[str, Any] = {k: missing.get(k, math.nan) if one is None else one for k, one in found.items()}
    return Comparison(**numbers)


def _curve(found: dict[str, Any]) -> Curve:
    numbers = {key: tuple(math.nan if n is None else n for n in found[key]) for key in ("x", "y", "error")}
    return Curve(**found | numbers)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
