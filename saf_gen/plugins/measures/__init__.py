"""Focus measures by name: spike counts (row, col) in, one number out; larger is sharper.

Each measure is one file of this folder, or belongs to a package that offers it under the entry point
``saf_gen.measures``. A measure with ``halves`` takes the counts of the two halves of a window, (2, row, col).

A score that grows with brightness follows the light, not the focus, wherever the light changes. Every measure
of degree d > 0 therefore has a brightness-normalised form, ``NAME_n``, divided by mean count**d. Measures of
whole windows, normalised or not, can also score the texture from intervals instead of counts, ``NAME_tfi``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np

from saf_gen.core.config.plain_plugins import declare_measure
from saf_gen.core.config.registry import PLUGIN_KINDS, add_plugin, build_plugin, names, plugin_class
from saf_gen.errors import BadInput, unknown

from saf_gen.plugins.measures._counts import counts_as_integers  # isort: skip  (digests of `_n` count the order)
from saf_gen.parts import Measure, cite_source, wants_halves, wants_intervals

__all__ = ["BrightnessNormalised", "IntervalTexture", "get_measure", "measure", "measure_names"]

KIND = "measures"
NORMALISED_SUFFIX, INTERVAL_SUFFIX = "_n", "_tfi"
STATEMENTS = ("degree", "cost", "source", "score_range", "halves", "intervals", "timed")
Function = TypeVar("Function", bound=Callable[..., float])


@dataclass(frozen=True)
class BrightnessNormalised:
    """Any measure, divided by mean count**degree; 0.0 where no pixel counted a spike.

    Counts multiplied by a factor keep their score, as with spike dispersion.
    """

    measure: Measure

    degree: ClassVar[int] = 0

    @property
    def source(self) -> str:
        """The source of the measure; the division is this project's."""
        return f"{cite_source(self.measure)}; divided by mean count**{self.measure.degree}"

    @property
    def halves(self) -> bool:
        """Whether the measure takes the counts of both halves of a window; the mean is then over both."""
        return wants_halves(self.measure)

    @property
    def score_range(self) -> str:
        """The range of the measure, divided by brightness."""
        return f"({getattr(self.measure, 'score_range', '')}) / mean count**{self.measure.degree}"

    @property
    def cost(self) -> float | None:
        """The measure's cost plus one addition per pixel for the mean; None where the measure states none."""
        cost = getattr(self.measure, "cost", None)
        return None if cost is None else cost + (2 if self.halves else 1)

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts as the measure takes them. Raise BadInput as the measure does."""
        numbers, degree = counts_as_integers(counts, halves=self.halves), self.measure.degree
        total = numbers.sum().item()  # an exact int for whole numbers, so that equal windows stay equal
        return self.measure(counts) * numbers.size**degree / total**degree if total else 0.0


@dataclass(frozen=True)
class IntervalTexture:
    """Any measure, of the texture from intervals (TFI) instead of counts (TFP).

    Each pixel holds what it would count in the window at the rate of the one interval between spikes around the
    window's middle: a real number in the unit of counts, 0.0 without such an interval. The measure, its degree, its
    cost and its range stay. However long the window, motion within it does not blur the texture, and the rest of the
    window is not used. An interval is a whole number of readouts, so bright pixels have few levels.

    References
    ----------
    Zhu et al., ICME 2019, doi:10.1109/ICME.2019.00248.
    """

    measure: Measure

    intervals: ClassVar[bool] = True

    @property
    def degree(self) -> int:
        """The degree of the measure: the texture is proportional to the light, as counts are."""
        return self.measure.degree

    @property
    def source(self) -> str:
        """The source of the measure, and that of the texture."""
        return f"{cite_source(self.measure)}; texture from intervals: {cite_source(type(self))}"

    @property
    def score_range(self) -> str:
        """The range of the measure."""
        return str(getattr(self.measure, "score_range", ""))

    @property
    def cost(self) -> float | None:
        """The cost of the measure, None where it states none; making the texture is not included."""
        return getattr(self.measure, "cost", None)

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of a texture (row, col), in counts. Raise BadInput as the measure does."""
        return self.measure(counts)


def measure(function: Function | None = None, /, **stated: Any) -> Any:
    """Make a function a focus measure, under its own name in this process.

    ::

        @saf_gen.measure
        def mean_step(counts, apart=1):
            return abs(np.diff(counts.astype(float), n=apart)).mean()

    It is then ``mean_step+argmax`` in names of methods, and ``my_file.py:mean_step+argmax`` on the command line, which
    needs no decorator. Parameters after the first are options.

    Parameters
    ----------
    function : called with counts, uint32 (row, col), read-only; returns a number, larger where it is sharper.
    **stated : ``degree``, ``cost``, ``source``, ``score_range``, ``halves``, ``intervals``, ``timed``, as
        :class:`saf_gen.parts.Measure` explains them. A degree that is not stated is found by trying.

    Returns
    -------
    The function, as it was; without a function, a decorator.

    Raises
    ------
    BadInput : for an unknown statement, and for the name of another measure.
    """
    for key in stated:
        if key not in STATEMENTS:
            raise unknown("statement of a measure:", key, allowed=STATEMENTS)

    def declare(function: Function) -> Function:
        declare_measure(function, **stated)
        add_plugin(KIND, function, name=function.__name__)
        return function

    return declare if function is None else declare(function)


def measure_names() -> list[str]:
    """Return the names of all measures and their ``_n`` forms, sorted.

    get_measure also takes the ``_tfi`` form of each that scores whole windows. A measure of another package
    that cannot be loaded is listed without its ``_n`` form; asking for it says why.
    """
    found = set(names(KIND))
    for name in names(KIND):
        try:
            if _grows_with_brightness(name):
                found.add(name + NORMALISED_SUFFIX)
        except BadInput:
            continue
    return sorted(found)


def _grows_with_brightness(name: str) -> bool:
    """Return whether a measure's degree is above 0, as its class states it or it does without options."""
    degree = getattr(plugin_class(KIND, name), "degree", 0)
    if isinstance(degree, property):
        degree = getattr(build_plugin(KIND, name), "degree", 0)
    return isinstance(degree, int) and degree > 0


def get_measure(name: str, **options: Any) -> Measure:
    """Return a focus measure by its name.

    Parameters
    ----------
    name : a name of :func:`measure_names`, ``file.py:Class`` or ``package.module:Class``, followed by ``_n``
        (brightness-normalised), ``_tfi`` (texture from intervals), both (``_n_tfi``) or neither.
    **options : the fields of the measure's dataclass. With a suffix they are those of the measure within.

    Returns
    -------
    Measure
        Called with counts (row, col), or (2, row, col) if it states ``halves``, it returns a float.

    Raises
    ------
    BadInput : for an unknown name or option, for a value that the measure refuses, for ``_n`` where the score does not
        grow with brightness, and for ``_tfi`` where the measure does not take counts of whole windows.
    """
    if name in names(KIND) or (":" in name and not name.endswith((NORMALISED_SUFFIX, INTERVAL_SUFFIX))):
        return build_plugin(KIND, name, **options)
    if name.endswith(INTERVAL_SUFFIX):
        return _interval_texture(name.removesuffix(INTERVAL_SUFFIX), options)
    base = name.removesuffix(NORMALISED_SUFFIX)
    if base == name or (base not in names(KIND) and ":" not in base):
        raise unknown(PLUGIN_KINDS[KIND], name, allowed=measure_names())
    measure = build_plugin(KIND, base, **options)
    if getattr(measure, "degree", 0) <= 0:
        raise BadInput(
            f"{PLUGIN_KINDS[KIND]} {base!r} has no form {name!r}: its score does not grow with brightness",
            allowed=f"{NORMALISED_SUFFIX} after measures of degree 1 or more",
            nearest=base,
        )
    return BrightnessNormalised(measure)


def _interval_texture(base: str, options: dict[str, Any]) -> Measure:
    measure = get_measure(base, **options)
    if wants_halves(measure) or wants_intervals(measure):
        reason = "it compares halves of a window" if wants_halves(measure) else "it takes intervals already"
        raise BadInput(
            f"{PLUGIN_KINDS[KIND]} {base!r} has no form {base + INTERVAL_SUFFIX!r}: {reason}",
            allowed=f"{INTERVAL_SUFFIX} after measures that take the counts of a whole window",
            nearest=base,
        )
    return IntervalTexture(measure)
