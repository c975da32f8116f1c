"""What a check is, and what it finds: laws and figures in words and numbers, and the data of its plot."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

from saf_gen.errors import SafGenError

if TYPE_CHECKING:
    from saf_gen.acceptance.validation.workload import DatasetMaker


class CheckSkipped(SafGenError):
    """A check that cannot be run here, such as one that needs a package that is not installed; says why."""


@dataclass(frozen=True)
class Comparison:
    """One figure of a check, its 95 % interval, and the range in which it must lie.

    Parameters
    ----------
    what : the figure, in a few words.
    measured : its value, from the product.
    expected : what the law says; NaN where the law gives a bound alone.
    at_least, at_most : the ends of what is allowed, by the statistics of the workload.
    low, high : the 95 % interval of ``measured``; NaN for a figure without scatter.
    unit : its unit, '' for a number.
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
        """Whether the figure lies in the allowed range; what is not a number does not."""
        return self.at_least <= self.measured <= self.at_most

    @property
    def tolerance_used(self) -> float:
        """The distance to what the law expects over the allowed one, or the figure over its only bound."""
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
    """A curve of a plot: points with error bars, or a line. All lists have one length."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    kind: Literal["line", "points"] = "line"
    error: tuple[float, ...] = ()


@dataclass(frozen=True)
class Plot:
    """The data of a check's picture."""

    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    log_x: bool = False
    log_y: bool = False


@dataclass(frozen=True)
class Finding:
    """What a check found: its figures, its plot, and remarks in plain sentences."""

    comparisons: tuple[Comparison, ...]
    plot: Plot | None = None
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Check:
    """One law that the product is held to.

    Parameters
    ----------
    name : its name, as ``--only`` takes it; the subject comes first.
    law : the law in words, one sentence.
    formula : the same as a formula.
    source : where the law comes from, with a DOI where there is one.
    workload : what is generated, in words.
    tolerance : what deviation is allowed, and why.
    run : makes the streams and compares; True as second argument for the small size.
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
        """The subject, by which checks are grouped: the name's first word."""
        return self.name.partition("_")[0]


@dataclass(frozen=True)
class Verdict:
    """How a check ended: ``passed``, ``failed``, ``skipped`` or ``broken``; the last two with the reason."""

    name: str
    outcome: Literal["passed", "failed", "skipped", "broken"]
    seconds: float
    comparisons: tuple[Comparison, ...] = ()
    plot: Plot | None = None
    remarks: tuple[str, ...] = ()
    reason: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return it as values of JSON; infinities and NaN become None."""
        return _finite(asdict(self))

    @classmethod
    def from_dict(cls, found: dict[str, Any]) -> Verdict:
        """Return the verdict that :meth:`as_dict` gave."""
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
