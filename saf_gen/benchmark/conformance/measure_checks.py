"""Checks of a focus measure: it returns a finite float for any counts, has its stated degree, and no side effects."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np
from scipy.ndimage import gaussian_filter

from saf_gen.benchmark.conformance._check_runner import (
    STATE_HINT,
    Check,
    CheckFailure,
    CheckWarning,
    check_docs,
    describe_crash,
)
from saf_gen.benchmark.conformance._samples import EDGE_CASE_COUNTS, sample_counts, sample_texture
from saf_gen.core.user_code import user_code
from saf_gen.parts import Measure, wants_frames, wants_halves

TYPES = (np.uint8, np.uint16, np.int16, np.int64, np.float32, np.float64)
IMAGE = 250, 400  # 100,000 pixels
BLUR = 3.0  # sigma in pixels
ROUNDING = 1e-4  # relative; a network computes with seven digits, and a degree of 0.001 would be ten times as much
Scorer = Callable[[np.ndarray], float]


def measure_checks(measure: Measure) -> dict[str, Check]:
    """Return the checks of a focus measure, by name."""
    checks: dict[str, Callable[[Measure], str]] = {
        "described": check_docs,
        "stated": _check_statements,
        "finite": _check_finite,
        "zero when empty": _check_zero_when_empty,
        "number types": _check_number_types,
        "memory layout": _check_memory_layout,
        "leaves input": _check_leaves_input,
        "repeatable": _check_repeatable,
        "degree": _check_degree,
        "sharp over blurred": _check_sharp_over_blurred,
        "speed": _check_speed,
    }
    return {name: partial(check, measure) for name, check in checks.items()}


def _check_statements(measure: Measure) -> str:
    """Check that the measure states a degree (a whole number, 0 or more) and a range, and that any cost is above 0."""
    degree = getattr(measure, "degree", None)
    if type(degree) is not int:
        raise CheckFailure(
            f"its degree is {degree!r}", "add degree: ClassVar[int], the power of brightness in the score"
        )
    if degree < 0:
        raise CheckFailure(f"its degree is {degree}, below 0", "change the score so that larger is sharper")
    score_range = str(getattr(measure, "score_range", "")).strip()
    if not score_range:
        raise CheckFailure("it states no range", 'add score_range: ClassVar[str], such as "from 0"')
    cost = getattr(measure, "cost", None)
    if cost is None:
        return f"degree {degree}, range {score_range}"
    if isinstance(cost, bool) or not isinstance(cost, int | float) or not 0 < cost < math.inf:
        raise CheckFailure(f"its cost is {cost!r}", "state operations per pixel, a number above 0, or leave it out")
    return f"degree {degree}, range {score_range}, cost {cost:.3g}"


def _check_finite(measure: Measure) -> str:
    """Check that the measure returns a finite float for counts of any kind, with and without the window length.

    No window of an evaluation is a single row or column, so a score of these that is not finite is a warning.
    """
    for name, counts in sorted(EDGE_CASE_COUNTS.items(), key=lambda case: 1 in case[1].shape):
        try:
            with user_code():
                score = _window_scorer(measure)(counts)
        except Exception as error:  # a third-party measure may raise anything
            raise CheckFailure(
                f"{describe_crash(error)}, for {name} counts {counts.shape}", "score counts of any size"
            ) from error
        if not isinstance(score, float):
            raise CheckFailure(
                f"the score of {name} counts is not a float: {type(score).__name__} {score!r}", "return float(score)"
            )
        if not math.isfinite(score):
            problem = CheckWarning if 1 in counts.shape else CheckFailure
            raise problem(f"the score of {name} counts is {score}", "return 0.0 instead of dividing by 0")
    return f"a finite float for counts that are {', '.join(EDGE_CASE_COUNTS)}"


def _check_zero_when_empty(measure: Measure) -> str:
    """Check that a measure of degree 0 returns 0.0 if there is no spike, so that an empty window is never the best."""
    score = _window_scorer(measure)(EDGE_CASE_COUNTS["empty"])
    if measure.degree == 0 and score != 0.0:
        raise CheckFailure(f"empty counts score {score}", "return 0.0 if no pixel counted a spike")
    return f"empty counts score {score:g}"


def _check_number_types(measure: Measure) -> str:
    """Check that the measure returns the same score for counts of every number type."""
    scorer, counts = _window_scorer(measure), sample_counts(37, 52)
    score = scorer(counts)
    for number_type in TYPES:
        other = scorer(counts.astype(number_type))
        if not math.isclose(other, score, rel_tol=1e-6, abs_tol=1e-12):
            raise CheckFailure(
                f"{number_type.__name__} changes the score, from {score:g} to {other:g}",
                "begin with counts.astype(np.float64): small integers wrap around",
            )
    return f"the same score for uint32, {', '.join(t.__name__ for t in TYPES)}"


def _check_memory_layout(measure: Measure) -> str:
    """Check that the measure returns the same score for every memory layout of the counts."""
    scorer, counts = _window_scorer(measure), sample_counts(37, 52)
    score = scorer(counts)
    for layout, other in {
        "with gaps": np.repeat(counts, 2, axis=1)[:, ::2],
        "by columns": np.asfortranarray(counts),
    }.items():
        if scorer(other) != score:
            raise CheckFailure(
                f"memory order changes the score: {scorer(other)!r} for counts {layout}, not {score!r}",
                "index pixels by row and column; np.ascontiguousarray copies if necessary",
            )
    return "the same score for counts by rows, by columns and with gaps"


def _check_leaves_input(measure: Measure) -> str:
    """Check that the measure does not modify the counts, because other methods get the same array."""
    before = sample_counts(37, 52)
    writeable = before.copy()
    _window_scorer(measure)(writeable)
    if not np.array_equal(writeable, before):
        raise CheckFailure("it changes the counts it is given", "work on a copy, such as counts.astype(np.float64)")
    return "the counts are unchanged"


def _check_repeatable(measure: Measure) -> str:
    """Check that the measure, or a fresh copy of it, always returns the same score for the same counts."""
    scorer, counts = _window_scorer(measure), sample_counts(37, 52)
    score = scorer(counts)
    scorer(EDGE_CASE_COUNTS["one-spike"])
    for when, again in {
        "after others": scorer(counts),
        "once more": scorer(counts),
        "by a fresh copy": _window_scorer(replace(measure))(counts),  # type: ignore[type-var]
    }.items():
        if again != score:
            raise CheckFailure(f"the same counts get another score {when}: {again!r}, not {score!r}", STATE_HINT)
    return "the same score again, after other counts, and by a fresh copy"


def _check_degree(measure: Measure) -> str:
    """Check that tripling the counts multiplies the score by 3 to the power of the stated degree."""
    # A half-window measure corrects for rounding to whole spikes by a constant, which is negligible for large counts.
    counts = sample_counts(37, 52) * np.uint32(10_000 if wants_halves(measure) else 1)
    scorer = _window_scorer(measure)
    one, three = scorer(counts), scorer(counts * np.uint32(3))
    if not math.isclose(three, one * 3.0**measure.degree, rel_tol=ROUNDING, abs_tol=1e-12):
        measured = f"degree {math.log(three / one, 3):.4g}" if one * three > 0 else "no power of brightness"
        raise CheckFailure(
            f"counts times 3 score {three:g}, the counts {one:g}: {measured}, but it states {measure.degree}",
            "state the actual degree; if the score is no power of brightness, divide by the mean count first",
        )
    return f"counts times 3 give the score times {3**measure.degree}"


def _check_sharp_over_blurred(measure: Measure) -> str:
    """Check that the measure does not score a natural texture lower than a blurred copy of it."""
    sharp = 50 * sample_texture(96, 96)
    scorer = _window_scorer(measure)
    high, low = scorer(sharp), scorer(gaussian_filter(sharp, BLUR, mode="wrap"))
    if not low <= high * (1 + 1e-9):
        raise CheckWarning(
            f"a texture blurred by {BLUR:g} pixels scores {low:.4g}, more than the sharp texture, {high:.4g}",
            "larger must mean sharper: change its sign, or say in its docstring when it fails",
        )
    return f"a texture blurred by {BLUR:g} pixels scores {low:.4g}, the sharp texture {high:.4g}"


def _check_speed(measure: Measure) -> str:
    """Return the time that a score of 100,000 pixels takes, as text; a slow measure does not fail."""
    halves = (2,) if wants_halves(measure) else ()
    counts = sample_counts(*halves, *IMAGE)
    measure(sample_counts(*halves, 37, 52))  # triggers compilation on first use
    times: list[float] = []
    while len(times) < 3 and sum(times) < 0.05:
        begin = perf_counter()
        measure(counts)
        times.append(perf_counter() - begin)
    return f"{1e3 * min(times):.3g} ms for 100,000 pixels"


def _window_scorer(measure: Measure) -> Scorer:
    """Return a function that scores counts, used as both halves if necessary; scores with a length are only checked."""

    def score(counts: np.ndarray) -> float:
        scored_counts = np.stack([counts, counts]) if wants_halves(measure) else counts
        plain = measure(scored_counts)
        if wants_frames(measure):
            timed = measure(scored_counts, frames=400)  # type: ignore[call-arg]
            if not (isinstance(timed, float) and math.isfinite(timed)):
                raise CheckFailure(f"with frames=400 it scores {timed!r}", "return a finite float")
        return plain

    return score
