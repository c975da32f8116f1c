"""Focus measures by name: each gives spike counts (row, col) a score, one number that is larger for a sharper picture.

Each measure is a file of this folder, or comes from a package with the entry point ``saf_gen.measures``. A measure with
``halves`` takes the counts of the two halves of a window, (2, row, col).

If the light changes, a score that grows with brightness follows the light instead of the focus. Every measure of degree
d > 0 therefore has a brightness-normalised form, ``NAME_n``, divided by mean count**d. All measures and normalised
forms except half-window measures also have a form ``NAME_tfi``, which scores the texture from intervals, not counts.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np

from saf_gen.core.config.plain_plugins import declare_measure
from saf_gen.core.config.registry import PLUGIN_KINDS, add_plugin, build_plugin, names, plugin_class
from saf_gen.errors import BadInput, unknown

from saf_gen.plugins.measures._counts import as_integers  # isort: skip  (order is in digests of `_n`)
from saf_gen.parts import Measure, cite_source, wants_halves, wants_intervals

__all__ = ["BrightnessNormalised", "IntervalTexture", "get_measure", "measure", "measure_names"]

KIND = "measures"
NORMALISED_SUFFIX, INTERVAL_SUFFIX = "_n", "_tfi"
STATEMENTS = ("degree", "cost", "source", "score_range", "halves", "intervals", "timed")
Function = TypeVar("Function", bound=Callable[..., float])


@dataclass(frozen=True)
class BrightnessNormalised:
    """A measure divided by mean count**degree; 0.0 if no pixel counted a spike.

    Like spike dispersion, the score does not change if all counts are multiplied by the same factor.
    """

    measure: Measure

    degree: ClassVar[int] = 0

    @property
    def source(self) -> str:
        """The source of the measure, with a note on the division, which is this project's."""
        return f"{cite_source(self.measure)}; divided by mean count**{self.measure.degree}"

    @property
    def halves(self) -> bool:
        """True if the measure takes the counts of both halves of a window; the mean is then over both halves."""
        return wants_halves(self.measure)

    @property
    def score_range(self) -> str:
        """The range of the measure, divided by brightness."""
        return f"({getattr(self.measure, 'score_range', '')}) / mean count**{self.measure.degree}"

    @property
    def cost(self) -> float | None:
        """The cost of the measure plus one addition per pixel, two with ``halves``, for the mean; None if unknown."""
        cost = getattr(self.measure, "cost", None)
        return None if cost is None else cost + (2 if self.halves else 1)

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts in the form that the measure takes.

        Raises BadInput if the measure does.
        """
        numbers, degree = as_integers(counts, halves=self.halves), self.measure.degree
        total = numbers.sum().item()  # an exact int for whole numbers, so that equal windows get equal scores
        return self.measure(counts) * numbers.size**degree / total**degree if total else 0.0


@dataclass(frozen=True)
class IntervalTexture:
    """A measure of the texture from intervals (TFI) instead of counts (TFP).

    A pixel of this texture holds the count that the window would have if the interval between spikes around the middle
    of the window repeated throughout it. It is a real number in the unit of counts, 0.0 if there is no such interval.
    The measure keeps its degree, cost and range. Motion within the window does not blur the texture, however long the
    window is, but the rest of the window is not used. An interval is a whole number of readouts, so bright pixels have
    few levels.

    References
    ----------
    Zhu et al., ICME 2019, doi:10.1109/ICME.2019.00248.
    """

    measure: Measure

    intervals: ClassVar[bool] = True

    @property
    def degree(self) -> int:
        """The degree of the wrapped measure, because textures are proportional to the light, like counts."""
        return self.measure.degree

    @property
    def source(self) -> str:
        """The sources of the measure and of the texture."""
        return f"{cite_source(self.measure)}; texture from intervals: {cite_source(type(self))}"

    @property
    def score_range(self) -> str:
        """The range of the wrapped measure; '' if it states no range."""
        return str(getattr(self.measure, "score_range", ""))

    @property
    def cost(self) -> float | None:
        """The cost of the wrapped measure, without making the texture; None if it states no cost."""
        return getattr(self.measure, "cost", None)

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of a texture (row, col), whose values are in the unit of counts.

        Raises BadInput if the measure does.
        """
        return self.measure(counts)


def measure(function: Function | None = None, /, **stated: Any) -> Any:
    """Register a function as a focus measure of the same name, for this process.

    In this example, the measure becomes part of the method ``mean_step+argmax``::

        @saf_gen.measure
        def mean_step(counts, apart=1):
            return abs(np.diff(counts.astype(float), n=apart)).mean()

    The command line finds it without the decorator, as ``my_file.py:mean_step+argmax``. Parameters of the function
    after the first are options of the measure.

    Parameters
    ----------
    function : callable, optional
        Called with counts, a read-only ndarray of uint32, shape (row, col); returns a number that is larger for a
        sharper picture.
    **stated
        Any of ``degree``, ``cost``, ``source``, ``score_range``, ``halves``, ``intervals`` and ``timed``, which
        :class:`saf_gen.parts.Measure` explains. If no degree is stated, it is found by trial.

    Returns
    -------
    callable
        The function itself, or a decorator if no function is given.

    Raises
    ------
    BadInput
        If a keyword is unknown, or if another measure has this name.
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
    """Return the sorted names of all measures and of their ``_n`` forms.

    :func:`get_measure` also takes the ``_tfi`` forms of all measures but half-window measures. If a measure of another
    package cannot be loaded, its ``_n`` form is missing from the list, and get_measure reports the reason.

    Returns
    -------
    list of str
        Names that :func:`get_measure` takes.
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
    """Return whether a measure has a degree above 0, as stated by its class or by an instance without options."""
    degree = getattr(plugin_class(KIND, name), "degree", 0)
    if isinstance(degree, property):
        degree = getattr(build_plugin(KIND, name), "degree", 0)
    return isinstance(degree, int) and degree > 0


def get_measure(name: str, **options: Any) -> Measure:
    """Return a focus measure by its name.

    Parameters
    ----------
    name : str
        One of :func:`measure_names`, ``file.py:Class`` or ``package.module:Class``, optionally followed by ``_n``
        (brightness-normalised), ``_tfi`` (texture from intervals) or ``_n_tfi`` (both).
    **options
        Fields of the measure's dataclass; with a suffix, the fields of the wrapped measure.

    Returns
    -------
    Measure
        A callable that takes counts (row, col), or (2, row, col) if it states ``halves``, and returns a float.

    Raises
    ------
    BadInput
        If the name or an option is unknown, if the measure refuses a value, if ``_n`` follows a measure whose score
        does not grow with brightness, or if ``_tfi`` follows a measure that does not take the counts of a complete
        window.
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
