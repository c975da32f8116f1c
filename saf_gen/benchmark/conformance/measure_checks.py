"""Checks of a focus measure: a finite float for any counts, its degree, and no side effect."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np
from scipy.ndimage import gaussian_filter

from saf_gen.benchmark.conformance._check_result import CheckFailure, CheckWarning
from saf_gen.benchmark.conformance._check_runner import Check, describe_crash
from saf_gen.benchmark.conformance._declaration_checks import described
from saf_gen.benchmark.conformance._sample_counts import EDGE_CASE_COUNTS, natural_texture, random_counts
from saf_gen.parts import Measure, wants_frames, wants_halves

__all__ = ["measure_checks"]

TYPES = (np.uint8, np.uint16, np.int16, np.int64, np.float32, np.float64)
PICTURE = 250, 400  # 100,000 pixels
BLUR = 3.0  # pixels, sigma
Whole = Callable[[np.ndarray], float]


def measure_checks(measure: Measure) -> dict[str, Check]:
    """The checks of one measure, by name."""
    checks = (
        described,
        stated,
        finite,
        zero_when_empty,
        number_types,
        memory_layout,
        leaves_input,
        repeatable,
        degree,
        sharp_over_blurred,
        speed,
    )
    return {check.__name__.replace("_", " "): partial(check, measure) for check in checks}


def stated(measure: Measure) -> str:
    """Its degree, a whole number from 0; its range; and its cost, where it states one."""
    stated = getattr(measure, "degree", None)
    if type(stated) is not int:
        raise CheckFailure(
            f"its degree is {stated!r}", "add degree: ClassVar[int], the power of brightness in the score"
        )
    if stated < 0:
        raise CheckFailure(f"its degree is {stated}, below 0", "turn the score over: larger is sharper")
    score_range = str(getattr(measure, "score_range", "")).strip()
    if not score_range:
        raise CheckFailure("it states no range", 'add score_range: ClassVar[str], such as "from 0"')
    cost = getattr(measure, "cost", None)
    if cost is None:
        return f"degree {stated}, range {score_range}"
    if isinstance(cost, bool) or not isinstance(cost, int | float) or not 0 < cost < math.inf:
        raise CheckFailure(
            f"its cost is {cost!r}", "state additions and multiplications a pixel, a number above 0, or none"
        )
    return f"degree {stated}, range {score_range}, cost {cost:.3g}"


def finite(measure: Measure) -> str:
    """A finite float for counts of any kind, told the length of the window or not."""
    for name, counts in EDGE_CASE_COUNTS.items():
        score = _score(measure, name, counts)
        if not isinstance(score, float):
            raise CheckFailure(
                f"the score of {name} counts is no float: {type(score).__name__} {score!r}",
                "return float(score)",
            )
        if not math.isfinite(score):
            raise CheckFailure(
                f"the score of {name} counts is {score}", "return 0.0 where it would divide by 0"
            )
    return f"a finite float for counts that are {', '.join(EDGE_CASE_COUNTS)}"


def zero_when_empty(measure: Measure) -> str:
    """0.0 without a spike, where the score does not grow with brightness: an empty window wins nowhere."""
    score = _whole(measure)(EDGE_CASE_COUNTS["empty"])
    if measure.degree == 0 and score != 0.0:
        raise CheckFailure(f"empty counts score {score}", "return 0.0 where no pixel counted a spike")
    return f"empty counts score {score:g}"


def number_types(measure: Measure) -> str:
    """The same score for counts of every number type."""
    whole, counts = _whole(measure), random_counts(37, 52)
    score = whole(counts)
    for other in TYPES:
        found = whole(counts.astype(other))
        if not math.isclose(found, score, rel_tol=1e-6, abs_tol=1e-12):
            raise CheckFailure(
                f"{other.__name__} changes the score, from {score:g} to {found:g}",
                "begin with counts.astype(np.float64): small integers wrap round",
            )
    return f"the same score for uint32, {', '.join(t.__name__ for t in TYPES)}"


def memory_layout(measure: Measure) -> str:
    """The same score however the counts lie in memory."""
    whole, counts = _whole(measure), random_counts(37, 52)
    score = whole(counts)
    for name, other in {
        "with gaps": np.repeat(counts, 2, axis=1)[:, ::2],
        "by columns": np.asfortranarray(counts),
    }.items():
        if whole(other) != score:
            raise CheckFailure(
                f"memory order changes the score: {whole(other)!r} for counts {name}, not {score!r}",
                "address pixels by row and column; np.ascontiguousarray copies where it must",
            )
    return "the same score for counts by rows, by columns and with gaps"


def leaves_input(measure: Measure) -> str:
    """It does not write into the counts: other methods are given the same array."""
    before = random_counts(37, 52)
    writeable = before.copy()
    _whole(measure)(writeable)
    if not np.array_equal(writeable, before):
        raise CheckFailure(
            "it changes the counts it is given", "work on a copy: counts.astype(np.float64) is one"
        )
    return "the counts are as they were"


def repeatable(measure: Measure) -> str:
    """The same score for the same counts: again, after other counts, and by a fresh copy."""
    whole, counts = _whole(measure), random_counts(37, 52)
    score = whole(counts)
    whole(EDGE_CASE_COUNTS["one-spike"])
    for when, again in {
        "after others": whole(counts),
        "once more": whole(counts),
        "by a fresh copy": _whole(replace(measure))(counts),  # type: ignore[type-var]
    }.items():
        if again != score:
            raise CheckFailure(
                f"the same counts get another score {when}: {again!r}, not {score!r}",
                "draw nothing by chance, and keep nothing between calls",
            )
    return "the same score again, after other counts, and by a fresh copy"


def degree(measure: Measure) -> str:
    """Counts times 3 give the score times 3 to the stated degree."""
    # What a measure of halves adds for counting in whole spikes does not scale: there it takes many.
    counts = random_counts(37, 52) * np.uint32(10_000 if wants_halves(measure) else 1)
    whole = _whole(measure)
    one, three = whole(counts), whole(counts * np.uint32(3))
    if not math.isclose(three, one * 3.0**measure.degree, rel_tol=1e-9, abs_tol=1e-12):
        measured = f"degree {math.log(three / one, 3):.4g}" if one * three > 0 else "no power of brightness"
        raise CheckFailure(
            f"counts times 3 give {three:g} in place of {one:g}: {measured}, and it states {measure.degree}",
            "state the degree that it has; a score with none is no power: divide by mean count first",
        )
    return f"counts times 3 give the score times {3**measure.degree}"


def sharp_over_blurred(measure: Measure) -> str:
    """A natural texture is not scored below the same picture blurred."""
    sharp = 50 * natural_texture(96, 96)
    blurred = gaussian_filter(sharp, BLUR, mode="wrap")
    whole = _whole(measure)
    high, low = whole(sharp), whole(blurred)
    if not low <= high * (1 + 1e-9):
        raise CheckWarning(
            f"a texture blurred by {BLUR:g} pixels scores {low:.4g}, above the sharp one's {high:.4g}",
            "larger must mean sharper: turn its sign, or say in its docstring where it fails",
        )
    return f"a texture blurred by {BLUR:g} pixels scores {low:.4g}, the sharp one {high:.4g}"


def speed(measure: Measure) -> str:
    """How long 100,000 pixels take; nobody fails by it."""
    halves = (2,) if wants_halves(measure) else ()
    counts = random_counts(*halves, *PICTURE)
    measure(random_counts(*halves, 37, 52))  # what is compiled on first use is compiled now
    times: list[float] = []
    while len(times) < 3 and sum(times) < 0.05:
        begin = perf_counter()
        measure(counts)
        times.append(perf_counter() - begin)
    return f"{1e3 * min(times):.3g} ms for 100,000 pixels"


def _score(measure: Measure, name: str, counts: np.ndarray) -> float:
    """The score, or a fault that names the counts."""
    try:
        return _whole(measure)(counts)
    except CheckFailure:
        raise
    except Exception as error:
        raise CheckFailure(
            f"{describe_crash(error)}, for {name} counts {counts.shape}", "score counts of any size"
        ) from error


def _whole(measure: Measure) -> Whole:
    """``measure`` as one of whole windows: one of halves gets the same counts twice, a timed one a length."""

    def score(counts: np.ndarray) -> float:
        given = np.stack([counts, counts]) if wants_halves(measure) else counts
        plain = measure(given)
        if wants_frames(measure):
            told = measure(given, frames=400)  # type: ignore[call-arg]
            if not (isinstance(told, float) and math.isfinite(told)):
                raise CheckFailure(
                    f"told that there were 400 frames, it scores {told!r}", "return a finite float"
                )
        return plain

    return score
