"""Operations: what a method declares to compute, and what this machine computes in a second.

Seconds depend on the machine and on the library behind a measure, operations do not: additions, multiplications and
roots, as each measure states them per pixel (``cost``). In the closed loop the clock advances by the operations of a
method divided by a stated rate, so that its record can be made again anywhere. That it declares what it computes is
checked: its measured seconds are compared with those that its operations would take at the rate of a reference measure
on the same region of the same machine.
"""

import math
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from saf_gen.plugins.measures import get_measure
from saf_gen.plugins.searches import Rejecting

OPERATIONS_PER_S = 1e9
"""Stated rate: one operation in each cycle of a processor of 1 GHz."""
REFERENCE, REFERENCE_S = "tenengrad", 0.03
OVER_DECLARED = 3.0
"""Measured seconds, divided by those of the declared operations, above which a method is flagged."""


@dataclass(frozen=True)
class DeclaredCost:
    """Operations of a method; None where it declares none, so that those of UNDECLARED count."""

    measure: float | None = None
    """Per pixel of a window that it scores."""
    window: float | None = None
    """Of the search itself, per window that it scores or looks at."""
    look: float | None = None
    """Per pixel of a window whose counts the search looks at."""

    def known(self) -> "DeclaredCost":
        """Return the cost with those of UNDECLARED for what is not declared."""
        pairs = ((getattr(self, name), getattr(UNDECLARED, name)) for name in ("measure", "window", "look"))
        return DeclaredCost(*(usual if stated is None else stated for stated, usual in pairs))


UNDECLARED = DeclaredCost(100.0, 2e5, 100.0)
"""Cost of what declares none: about as dear as the dearest that is shipped, or dearer."""
OF_SHIPPED = {"PeakFit": DeclaredCost(None, 1e5, 2.0), "PhotonAware": DeclaredCost(None, 3e4)}
"""Costs of searches that do more than compare scores. They stand here, so that a cost leaves the digest of a search."""
SHIPPED = DeclaredCost(None, 4e3)
"""Cost of the other searches of saf_gen, which look at no counts. All were measured as time at OPERATIONS_PER_S."""


def declared_cost(measure: Any, search: Any) -> DeclaredCost:
    """Return what a measure (``cost``) and a search (``cost`` per window, ``look_cost`` per pixel) declare."""
    own = _of_search(search)
    return DeclaredCost(number_or_none(getattr(measure, "cost", None)), own.window, own.look)


def _of_search(search: Any) -> DeclaredCost:
    if isinstance(search, Rejecting):
        one, rule = _of_search(search.search), _of_search(search.rule)
        return DeclaredCost(None, None if one.window is None else max(one.window, rule.window or 0.0), rule.look)
    if type(search).__module__.startswith("saf_gen.plugins."):
        return OF_SHIPPED.get(type(search).__name__, SHIPPED)
    return DeclaredCost(None, *(number_or_none(getattr(search, name, None)) for name in ("cost", "look_cost")))


def number_or_none(value: Any) -> float | None:
    """Return a declared cost as a float, or None if it is no finite number of at least 0."""
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if plain and math.isfinite(value) and value >= 0 else None


def reference_rate(shape: tuple[int, int]) -> float:
    """Return how many operations a second this machine computes of REFERENCE on counts of this shape, now.

    It is the mean over REFERENCE_S, so that other programs slow the reference as they slow the methods.
    """
    measure: Any = get_measure(REFERENCE)
    counts = (np.arange(shape[0] * shape[1], dtype=np.uint32) % 7).reshape(shape)
    calls, begin = 0, perf_counter()
    while (seconds := perf_counter() - begin) < REFERENCE_S or not calls:
        measure(counts)
        calls += 1
    return float(calls * measure.cost * counts.size / seconds)
