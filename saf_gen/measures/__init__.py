"""Focus measures, by name: spike counts (row, col) in, one number out; larger is sharper.

A measure with ``halves`` takes the counts of the two halves of a window, (2, row, col).

Each measure is one file of this folder, or a package's, offered under the entry point ``saf_gen.measures``.
A score that grows with brightness follows the light, not the focus, wherever the light changes. So every
measure of degree d > 0 has a twin, its name with ``_n``, which divides by mean count**d. The twins are made
here, for all measures alike: none has a file.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from saf_gen.errors import BadInput, unknown
from saf_gen.measures._counts import as_numbers
from saf_gen.parts import Measure, wants_halves
from saf_gen.registry import ROOMS, build, names, part_class

__all__ = ["ByBrightness", "get_measure", "measure_names"]

ROOM = "measures"
SUFFIX = "_n"


@dataclass(frozen=True)
class ByBrightness:
    """Any measure, divided by mean count**degree; 0.0 where no pixel counted a spike.

    Counts times a give the same score, as with spike dispersion. Range: that of the measure, over the mean
    count to its degree.
    """

    measure: Measure

    degree: ClassVar[int] = 0

    @property
    def source(self) -> str:
        """Where the measure comes from; the division is ours."""
        return f"{getattr(self.measure, 'source', '')}; divided by mean count**{self.measure.degree}"

    @property
    def halves(self) -> bool:
        """Whether the measure takes the counts of both halves of a window; the mean is then over both."""
        return wants_halves(self.measure)

    @property
    def score_range(self) -> str:
        """Range of the measure, over brightness."""
        return f"({getattr(self.measure, 'score_range', '')}) / mean count**{self.measure.degree}"

    def __call__(self, counts: np.ndarray) -> float:
        """Score of counts as the measure takes them. Raises BadInput as the measure does."""
        numbers, degree = as_numbers(counts, halves=self.halves), self.measure.degree
        total = numbers.sum().item()  # an exact int for whole numbers, so that equal windows stay equal
        return self.measure(counts) * numbers.size**degree / total**degree if total else 0.0


def measure_names() -> list[str]:
    """Every name that get_measure takes, twins too, sorted.

    A measure of another package that cannot be loaded is listed without a twin; asking for it says why.
    """
    found = set(names(ROOM))
    for name in names(ROOM):
        try:
            if getattr(part_class(ROOM, name), "degree", 0) > 0:
                found.add(name + SUFFIX)
        except BadInput:
            continue
    return sorted(found)


def get_measure(name: str, **options: Any) -> Measure:
    """The focus measure ``name``; options are the keys of the measure, for a twin those of its measure.

    Raises BadInput for an unknown name or key, for a value that the measure refuses, and for the twin of a
    measure that does not depend on brightness.
    """
    if name in names(ROOM):
        return build(ROOM, name, **options)
    base = name.removesuffix(SUFFIX)
    if base == name or base not in names(ROOM):
        raise unknown(ROOMS[ROOM], name, measure_names())
    measure = build(ROOM, base, **options)
    if getattr(measure, "degree", 0) <= 0:
        raise BadInput(
            f"{ROOMS[ROOM]} {base!r} has no twin {name!r}: its score does not grow with brightness",
            allowed="twins of measures of degree 1 or more",
            nearest=base,
        )
    return ByBrightness(measure)
