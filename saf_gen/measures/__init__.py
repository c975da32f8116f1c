"""Focus measures, by name: spike counts (row, col) in, one number out; larger is sharper.

A measure with ``halves`` takes the counts of the two halves of a window, (2, row, col).

Each measure is one file of this folder, or a package's, offered under the entry point ``saf_gen.measures``.
A score that grows with brightness follows the light, not the focus, wherever the light changes. So every
measure of degree d > 0 has a twin, its name with ``_n``, which divides by mean count**d. And every measure of
a whole window, twins too, can look at the texture from intervals in place of counts: its name with ``_tfi``.
Both are made here, for all measures alike: none has a file.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from saf_gen.core.config.registry import PLUGIN_KINDS, build, names, plugin_class
from saf_gen.errors import BadInput, unknown
from saf_gen.measures._counts import as_numbers
from saf_gen.parts import Measure, wants_halves, wants_intervals

__all__ = ["BrightnessNormalised", "IntervalTexture", "get_measure", "measure_names"]

ROOM = "measures"
NORMALISED_SUFFIX, INTERVAL_SUFFIX = "_n", "_tfi"


@dataclass(frozen=True)
class BrightnessNormalised:
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

    @property
    def cost(self) -> float | None:
        """That of the measure, and an addition a pixel for the mean; None where the measure states none."""
        inner, images = getattr(self.measure, "cost", None), 2 if self.halves else 1
        return None if inner is None else inner + images

    def __call__(self, counts: np.ndarray) -> float:
        """Score of counts as the measure takes them. Raises BadInput as the measure does."""
        numbers, degree = as_numbers(counts, halves=self.halves), self.measure.degree
        total = numbers.sum().item()  # an exact int for whole numbers, so that equal windows stay equal
        return self.measure(counts) * numbers.size**degree / total**degree if total else 0.0


@dataclass(frozen=True)
class IntervalTexture:
    """Any measure, of the texture from intervals (TFI) in place of counts (TFP).

    Each pixel is given what it would count in the window at the rate of the one interval between spikes round
    the window's middle: real numbers in the unit of counts, 0.0 for a pixel without such an interval. So the
    measure, its degree and its range stay; blur by motion goes, however long the window, and what the rest of
    the window saw is not used. An interval is a whole number of readouts, so bright pixels have few levels.
    """

    measure: Measure

    intervals: ClassVar[bool] = True

    @property
    def degree(self) -> int:
        """That of the measure: light times a divides intervals by a."""
        return self.measure.degree

    @property
    def source(self) -> str:
        """Where the measure comes from, and the texture."""
        return (
            f"{getattr(self.measure, 'source', '')}; texture from intervals: Zhu et al., A Retina-inspired "
            "Sampling Method for Visual Texture Reconstruction, ICME 2019, doi:10.1109/ICME.2019.00248"
        )

    @property
    def score_range(self) -> str:
        """Range of the measure."""
        return str(getattr(self.measure, "score_range", ""))

    @property
    def cost(self) -> float | None:
        """That of the measure, None where it states none; the texture is made before."""
        return getattr(self.measure, "cost", None)

    def __call__(self, counts: np.ndarray) -> float:
        """Score of a texture (row, col), in counts. Raises BadInput as the measure does."""
        return self.measure(counts)


def measure_names() -> list[str]:
    """Every measure and its twin, sorted; get_measure takes each of a whole window with ``_tfi`` behind, too.

    A measure of another package that cannot be loaded is listed without a twin; asking for it says why.
    """
    found = set(names(ROOM))
    for name in names(ROOM):
        try:
            if _grows(name):
                found.add(name + NORMALISED_SUFFIX)
        except BadInput:
            continue
    return sorted(found)


def _grows(name: str) -> bool:
    """Whether a measure's score grows with brightness: as its class says, or it does without options."""
    degree = getattr(plugin_class(ROOM, name), "degree", 0)
    if isinstance(degree, property):
        degree = getattr(build(ROOM, name), "degree", 0)
    return isinstance(degree, int) and degree > 0


def get_measure(name: str, **options: Any) -> Measure:
    """The focus measure ``name``, or the one of ``file.py:Class``.

    Options are the keys of the measure, for a twin or on textures those of the measure within.
    Raises BadInput for an unknown name or key, for a value that the measure refuses, for the twin of a
    measure that does not depend on brightness, and for the texture of intervals for one that compares halves.
    """
    if name in names(ROOM) or (":" in name and not name.endswith((NORMALISED_SUFFIX, INTERVAL_SUFFIX))):
        return build(ROOM, name, **options)
    if name.endswith(INTERVAL_SUFFIX):
        return _from_intervals(name.removesuffix(INTERVAL_SUFFIX), options)
    base = name.removesuffix(NORMALISED_SUFFIX)
    if base == name or (base not in names(ROOM) and ":" not in base):
        raise unknown(PLUGIN_KINDS[ROOM], name, measure_names())
    measure = build(ROOM, base, **options)
    if getattr(measure, "degree", 0) <= 0:
        raise BadInput(
            f"{PLUGIN_KINDS[ROOM]} {base!r} has no twin {name!r}: its score does not grow with brightness",
            allowed="twins of measures of degree 1 or more",
            nearest=base,
        )
    return BrightnessNormalised(measure)


def _from_intervals(base: str, options: dict[str, Any]) -> Measure:
    measure = get_measure(base, **options)
    if wants_halves(measure) or wants_intervals(measure):
        what = "it compares halves of a window" if wants_halves(measure) else "it takes intervals already"
        raise BadInput(
            f"{PLUGIN_KINDS[ROOM]} {base!r} has no {base + INTERVAL_SUFFIX!r}: {what}",
            allowed="measures that take the counts of a whole window",
            nearest=base,
        )
    return IntervalTexture(measure)
