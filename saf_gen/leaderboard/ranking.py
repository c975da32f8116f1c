"""The ranking: records become the rows of the leaderboard, one per method, best first, with their intervals.

Every scene has the same weight, and so has every light within a scene. Methods are ranked by **answerable success**:
the fraction of answers within one depth of focus, over the sequences that have an answer, because the lens comes as
near to the focus. Answers where there is none, and abstentions where there is one, are columns beside it, with a stated
cost of both, and do not rank.

Profiles and comparisons of neighbours in rank follow Agarwal et al. (2021, arXiv:2108.13264), adapted to sequences that
share scenes. A rank depends on the fraction of answers within one depth of focus; a profile gives this fraction for
many limits. The probability of improvement is the fraction of sequences on which one method is nearer to the truth than
the other. All are over the sequences that have an answer. Their intervals are computed like those of success rates, and
each holds alone. The test that tells neighbours apart covers all pairs of neighbours at once.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite
from operator import attrgetter
from statistics import median
from typing import Any, TypeVar

import numpy as np

from saf_gen.benchmark.records import NO_INSIDE, Record
from saf_gen.core.plain_text import plural
from saf_gen.leaderboard.intervals import (
    COARSE,
    CONFIDENCE,
    MIN_SCENES,
    Interval,
    adjust_p_values,
    difference_intervals,
    mean_interval,
    median_interval,
    rate_intervals,
)
from saf_gen.leaderboard.merging import merge_records

T = TypeVar("T")
RecordValue = Callable[[Record], float | None]
RULE = "answerable_1dof"
"""The name of the rule by which methods are ranked: that of its column in files."""
MAX_SHARPNESS_LOST = 0.05
"""Largest loss of sharpness at an answer that counts as a success by sharpness."""
FALSE_ABSTENTION_COST = 0.5
"""Cost of no answer where there is one; that of a wrong answer and of a failure is 1."""


def right_within(limit_dof: float = 1.0) -> RecordValue:
    """Return a function of a record: whether it answered within a limit, None if the recording has no answer."""

    def value(record: Record) -> float | None:
        if not record.answerable:
            return None
        return float(record.judgement.status == "answered" and record.success(limit_dof) is True)

    return value


def sharp_within(stated: Collection[str]) -> RecordValue:
    """Return a function of a record: whether it lost at most MAX_SHARPNESS_LOST, None if there is no answer to give.

    It is also None outside of the sequences in ``stated``, which state the sharpness at any position: otherwise an
    abstention would be wrong where nobody can be right.
    """

    def value(record: Record) -> float | None:
        if not record.answerable or record.what.sequence not in stated:
            return None
        lost = record.judgement.sharpness_lost  # None without an answer
        return float(lost is not None and lost <= MAX_SHARPNESS_LOST)

    return value


def error_from_optimum(record: Record) -> float | None:
    """Return answer minus optimum of the method's own measure, in depths of focus; None if one of them is unknown."""
    answer, optimum, dof = record.judgement.position, record.judgement.optimum, record.judgement.depth_of_focus
    return None if answer is None or optimum is None or not isfinite(optimum) or not dof else (answer - optimum) / dof


def error_cost(record: Record) -> float | None:
    """Return the cost of a record: 1 for a wrong answer or a failure, FALSE_ABSTENTION_COST for a false abstention.

    An answer where there is none is wrong. The cost is None if the truth is unknown.
    """
    if record.answerable is None:
        return None
    if record.judgement.status == "abstained":
        return FALSE_ABSTENTION_COST if record.answerable else 0.0
    return 1 - (right_within()(record) or 0.0)


def describe_size(records: Iterable[Record]) -> str:
    """Return the number of sequences and, if some have no answer, of those that have one, as text."""
    known = {r.what.sequence: r.answerable for r in records}
    with_answer = f", {sum(map(bool, known.values()))} of them with an answer" if False in known.values() else ""
    return plural(len(known), "sequence") + with_answer


def group_by(items: Iterable[T], *names: str) -> dict[Any, list[T]]:
    """Return the items by the value of an attribute, or by the values of several, in order of appearance."""
    groups: dict[Any, list[T]] = {}
    for item in items:
        groups.setdefault(attrgetter(*names)(item), []).append(item)
    return groups


def mean_by_scene(records: Sequence[Record], value: RecordValue) -> dict[str, float]:
    """Return the mean value of each scene.

    Known values are averaged over the sequences of each light, then over the lights of the scene. A scene without any
    known value is left out.
    """
    scenes: dict[str, dict[str | None, list[float]]] = {}
    for record in records:
        if (number := value(record)) is not None:
            scenes.setdefault(record.what.scene, {}).setdefault(record.what.light, []).append(float(number))
    return {
        scene: float(np.mean([np.mean(numbers) for numbers in lights.values()])) for scene, lights in scenes.items()
    }


def mean_over_scenes(records: Sequence[Record], value: RecordValue) -> float | None:
    """Return the mean of the scene means of mean_by_scene, or None if every value is unknown."""
    scenes = mean_by_scene(records, value)
    return float(np.mean(list(scenes.values()))) if scenes else None


def median_magnitude(numbers: Iterable[float | None]) -> float | None:
    """Return the median of the known absolute values, or None if all values are unknown."""
    known = [abs(number) for number in numbers if number is not None]
    return float(np.median(known)) if known else None


@dataclass(frozen=True)
class Outcomes:
    """Outcomes of M methods on the N sequences, in S scenes, that have an answer and whose success is known for all.

    Attributes
    ----------
    methods, scenes : tuple of str
        Names.
    sequences : tuple of Record
        One record of each sequence, which describes the sequence.
    scene_of : ndarray of int, shape (N,)
        Number of the scene of each sequence.
    weights : ndarray of float, shape (N,)
        Weight of each sequence within its scene. The lights of a scene have equal weight, and the weights of a scene
        sum to 1.
    success : ndarray of bool, shape (M, N)
        Whether the answer is within one depth of focus.
    errors : ndarray of float, shape (M, N)
        Absolute error of the answer in depths of focus; NaN if there is no error.
    times : ndarray of float, shape (M, N)
        Time to focus in seconds; NaN if unknown.
    """

    methods: tuple[str, ...]
    scenes: tuple[str, ...]
    sequences: tuple[Record, ...]
    scene_of: np.ndarray
    weights: np.ndarray
    success: np.ndarray
    errors: np.ndarray
    times: np.ndarray

    @property
    def counts(self) -> np.ndarray:
        """Number of sequences in each scene, int (S,)."""
        return np.bincount(self.scene_of, minlength=len(self.scenes))

    def average_by_scene(self, values: np.ndarray) -> np.ndarray:
        """Return the weighted mean in each scene, float (..., S), of values by sequence (..., N)."""
        weights = np.zeros((len(self.scene_of), len(self.scenes)))
        weights[np.arange(len(self.scene_of)), self.scene_of] = self.weights
        return np.asarray(values @ weights)

    def select(self, methods: Mapping[str, str], sequences: Sequence[bool] | None = None) -> "Outcomes":
        """Return the outcomes of some methods on some sequences, with new weights.

        ``methods`` maps the name of each selected method to its new name; ``sequences`` flags the sequences to keep, by
        default all.
        """
        rows = [self.methods.index(name) for name in methods]
        kept = np.ones(len(self.sequences), bool) if sequences is None else np.asarray(sequences, bool)
        judged = [record for record, is_kept in zip(self.sequences, kept, strict=True) if is_kept]
        values = {name: getattr(self, name)[rows][:, kept] for name in ("success", "errors", "times")}
        return _weigh(tuple(methods.values()), judged, **values)

    def answers_within(self, limit_dof: float) -> np.ndarray:
        """Return which answers are within ``limit_dof`` depths of focus, bool (M, N); ``success`` at a limit of 1."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.errors <= limit_dof)

    def find_wins(self) -> np.ndarray:
        """Return the weighted fraction of sequences that method j solves and k does not, by scene, float (M, M, S)."""
        wins = np.zeros((len(self.methods), len(self.methods), len(self.scenes)))
        for scene in range(len(self.scenes)):
            in_scene = self.scene_of == scene
            solved = self.success[:, in_scene].astype(np.float64)
            wins[:, :, scene] = (solved * self.weights[in_scene]) @ (1 - solved).T
        return wins


def collect_outcomes(by_method: Mapping[str, Sequence[Record]]) -> Outcomes:
    """Return the outcomes of the methods for which any success is known, with scenes sorted by name.

    Sequences that have no answer, and those for which the success of one of these methods is unknown, are left out.
    Every method must have a record of every sequence (see merge_records).
    """
    is_right = right_within()
    known = {name: group for name, group in by_method.items() if any(r.answerable for r in group)}
    unknown = {r.what.sequence for group in known.values() for r in group if r.success() is None}
    first = next(iter(known.values()), ())
    judged = [record for record in first if record.answerable and record.what.sequence not in unknown]
    columns = {record.what.sequence: number for number, record in enumerate(judged)}
    success = np.zeros((len(known), len(judged)), dtype=bool)
    errors, times = np.full((2, len(known), len(judged)), np.nan)
    for row, group in enumerate(known.values()):
        for record in group:
            if (column := columns.get(record.what.sequence)) is not None:
                success[row, column] = is_right(record)
                if record.judgement.error_dof is not None:
                    errors[row, column] = abs(record.judgement.error_dof)
                if record.judgement.time_to_focus_s is not None:
                    times[row, column] = record.judgement.time_to_focus_s
    return _weigh(tuple(known), judged, success=success, errors=errors, times=times)


def _weigh(methods: tuple[str, ...], sequences: Sequence[Record], **values: np.ndarray) -> Outcomes:
    """Return the outcomes, with weights computed from these sequences."""
    scenes = sorted({record.what.scene for record in sequences})
    numbers = {scene: number for number, scene in enumerate(scenes)}
    of_light = Counter((record.what.scene, record.what.light) for record in sequences)
    lights = Counter(scene for scene, _ in of_light)
    return Outcomes(
        methods,
        tuple(scenes),
        tuple(sequences),
        np.array([numbers[r.what.scene] for r in sequences], dtype=np.intp),
        np.array([1 / (lights[r.what.scene] * of_light[r.what.scene, r.what.light]) for r in sequences]),
        **values,
    )


LEAST_TIMED_S = 0.02
"""Shortest time of a sequence that is compared with what a method declares; calls of Python decide shorter ones."""
TIE_TOLERANCE = 1e-9
"""Largest difference at which two success rates count as equal; averages of averages may differ in the last bit."""
TURNS_OF_A_PASS = 2
"""Reversals of a lens that goes to one end of its travel, sweeps to the other end, and returns to the answer."""


@dataclass(frozen=True)
class LeaderboardRow:
    """One method of the leaderboard; a number is None if no sequence has the truth that it needs."""

    rank: int | None
    tied: tuple[str, ...]
    """The other methods with the same rank."""
    method: str
    answerable_half_dof: float | None
    """Fraction of answers within half a depth of focus, over the sequences that have an answer within one."""
    answerable_1dof: float | None
    answerable_2dof: float | None
    answerable: int | None
    """Number of sequences that have an answer; None, like the next three, if the truth of all is unknown."""
    without_answer: int | None
    """Number of sequences that have none."""
    false_answers: int | None
    """Number of answers on sequences that have none; None if all have one."""
    false_abstentions: int | None
    """Number of abstentions on sequences that have an answer."""
    error_cost: float | None
    """Mean of :func:`saf_gen.leaderboard.ranking.error_cost` over the sequences of known truth."""
    median_error_dof: float | None
    """Median error, like the next four numbers, of the answers on sequences that are not known to have none."""
    median_error_travel: float | None
    median_error_frames: float | None
    median_blur_px: float | None
    median_sharpness_lost: float | None
    p90_sharpness_lost: float | None
    answerable_lost_5: float | None
    """Fraction of answers that lose at most 5 % of the sharpness, over the sequences that have an answer and state it.
    """
    median_error_optimum_dof: float | None
    """Median distance of the answers from the optimum of the method's own measure, where it is known."""
    success_by_light: tuple[tuple[str, float | None], ...]
    abstained: int
    failed: int
    sequences: int
    frames_seen: float | None
    lens_travel: float | None
    time_to_focus_s: float | None
    reversals: float | None
    hunting: float | None
    windows: float | None
    seconds: float | None
    operations: float | None
    over_declared: float | None
    """Seconds of all runs, divided by those that the declared operations would take at the reference rate."""
    answerable_1dof_low: float | None = None
    answerable_1dof_high: float | None = None
    median_error_dof_low: float | None = None
    median_error_dof_high: float | None = None
    time_to_focus_low_s: float | None = None
    time_to_focus_high_s: float | None = None
    rank_best: int | None = None
    rank_worst: int | None = None
    behind_best_low: float | None = None
    behind_best_high: float | None = None
    level_with_best: bool | None = None
    missing_reason: str = ""
    """Why the intervals (the eleven fields above) are missing; '' if they are known."""
    verified: str | None = None
    """``re-run here``, ``re-run elsewhere``, ``differs`` or ``claimed``; None if no row was verified."""
    failed_check: str | None = None
    """First check of ``saf-gen methods check`` that the method fails; None if there is none."""
    success_least_blur: float | None = None
    """``answerable_1dof`` if the least blur were the truth wherever it is far from it; None if it nowhere is."""


@dataclass(frozen=True)
class MethodIntervals:
    """Confidence intervals of one method of a ranking; None means unknown, and ``missing_reason`` says why."""

    success: Interval | None = None
    error: Interval | None = None
    """Interval of the median error."""
    time: Interval | None = None
    """Interval of the mean time to focus."""
    rank: tuple[int, int] | None = None
    """Best and worst rank."""
    deficit_to_best: Interval | None = None
    """Interval of the best method's success minus this method's; if several methods are best, the nearest counts."""
    level_with_best: bool | None = None
    """Whether no better method can be told apart from this method, so that its best possible rank is 1."""
    missing_reason: str = ""


def rank_methods(records: Iterable[Record]) -> tuple[LeaderboardRow, ...]:
    """Return the leaderboard of these records, best first.

    Methods are ranked by answers within one depth of focus, over the sequences that have an answer. Rows of equal rank
    are ordered by median error in depths of focus, or in travels where these are not known, then by name. Methods for
    which no success is known come last and have no rank, like all methods if no sequence has an answer.

    Parameters
    ----------
    records : iterable of Record
        One record for each method and sequence.

    Returns
    -------
    tuple of LeaderboardRow
        One row for each method.

    Raises
    ------
    BadInput
        If the records cannot be compared: see merge_records.
    """
    by_method = group_by(merge_records({"": list(records)}), "who.method")
    return rank(by_method, collect_outcomes(by_method))


def rank(by_method: Mapping[str, Sequence[Record]], outcomes: Outcomes) -> tuple[LeaderboardRow, ...]:
    """Return the leaderboard, best first, of records that merge_records has accepted, and of their outcomes."""
    lights = sorted({r.what.light for group in by_method.values() for r in group if r.what.light is not None})
    stated = _sequences_of_known_sharpness([record for group in by_method.values() for record in group])
    rows = [_average(method, group, lights=lights, stated=stated) for method, group in by_method.items()]
    intervals = method_intervals(by_method, outcomes)
    best = max((row.answerable_1dof for row in rows if row.answerable_1dof is not None), default=0.0)
    ranked = [_add_intervals(_rank(row, rows), intervals.get(row.method), best=best) for row in rows]
    return tuple(sorted(ranked, key=_sort_key))


def _sort_key(row: LeaderboardRow) -> tuple[float, float, str]:
    error = row.median_error_travel if row.median_error_dof is None else row.median_error_dof
    return inf if row.rank is None else row.rank, inf if error is None else error, row.method


def _rank(row: LeaderboardRow, rows: Sequence[LeaderboardRow]) -> LeaderboardRow:
    rate = row.answerable_1dof
    if rate is None:
        return row
    others = {r.method: r.answerable_1dof for r in rows if r.answerable_1dof is not None and r is not row}
    tied = sorted(method for method, success in others.items() if abs(success - rate) <= TIE_TOLERANCE)
    rank = 1 + sum(success > rate + TIE_TOLERANCE for success in others.values())
    return replace(row, rank=rank, tied=tuple(tied))


def _add_intervals(row: LeaderboardRow, intervals: MethodIntervals | None, *, best: float) -> LeaderboardRow:
    """Return a ranked row with its intervals; ``best`` is the success rate of the best method."""
    if intervals is None or row.answerable_1dof is None:
        return row
    pairs = {
        ("answerable_1dof_low", "answerable_1dof_high"): (row.answerable_1dof, intervals.success),
        ("median_error_dof_low", "median_error_dof_high"): (row.median_error_dof, intervals.error),
        ("time_to_focus_low_s", "time_to_focus_high_s"): (row.time_to_focus_s, intervals.time),
        ("rank_best", "rank_worst"): (row.rank, intervals.rank),
        ("behind_best_low", "behind_best_high"): (best - row.answerable_1dof, intervals.deficit_to_best),
    }
    ends: dict[str, Any] = {
        name: end
        for names, (value, interval) in pairs.items()
        if _holds(interval, value)
        for name, end in zip(names, interval or (), strict=True)
    }
    level = intervals.level_with_best if "rank_best" in ends else None
    return replace(row, **ends, level_with_best=level, missing_reason=intervals.missing_reason)


def _holds(interval: tuple[float, float] | None, value: float | None) -> bool:
    """Return whether an interval is known and contains the value of its row.

    Values count all sequences whose success is known for the method, intervals those of known success for every method.
    Where these differ, an interval without the value is not about the value, and is shown as missing.
    """
    if interval is None or value is None:
        return False
    low, high = interval
    return low - TIE_TOLERANCE <= value <= high + TIE_TOLERANCE


def _average(
    method: str, records: Sequence[Record], *, lights: Sequence[str], stated: Collection[str]
) -> LeaderboardRow:
    """Return the row of a method without rank and intervals, with its success under each of the ``lights``.

    ``stated`` are the sequences that state their sharpness.
    """
    records = [r for r in records if r.what.obstacle != NO_INSIDE]  # there it did not run, at no cost
    judged = [r for r in records if r.answerable is not False]
    known = [r for r in records if r.answerable is not None]
    without = [r for r in known if not r.answerable]
    lost = [r.judgement.sharpness_lost for r in judged if r.judgement.sharpness_lost is not None]
    return LeaderboardRow(
        rank=None,
        tied=(),
        method=method,
        answerable_half_dof=mean_over_scenes(records, right_within(0.5)),
        answerable_1dof=mean_over_scenes(records, right_within()),
        answerable_2dof=mean_over_scenes(records, right_within(2)),
        answerable=len(known) - len(without) if known else None,
        without_answer=len(without) if known else None,
        false_answers=sum(r.judgement.status == "answered" for r in without) if without else None,
        false_abstentions=sum(r.answerable is True and r.judgement.status == "abstained" for r in known)
        if known
        else None,
        error_cost=mean_over_scenes(records, error_cost),
        median_error_dof=median_magnitude(r.judgement.error_dof for r in judged),
        median_error_travel=median_magnitude(r.judgement.error for r in judged),
        median_error_frames=median_magnitude(r.judgement.error_frames for r in judged),
        median_blur_px=median_magnitude(r.judgement.blur_px for r in judged),
        median_sharpness_lost=median_magnitude(lost),
        p90_sharpness_lost=float(np.quantile(lost, 0.9)) if lost else None,
        answerable_lost_5=mean_over_scenes(records, sharp_within(stated)),
        median_error_optimum_dof=median_magnitude(map(error_from_optimum, judged)),
        success_by_light=tuple(
            (light, mean_over_scenes([r for r in records if r.what.light == light], right_within())) for light in lights
        ),
        abstained=sum(r.judgement.status == "abstained" for r in records),
        failed=sum(r.judgement.status == "failed" for r in records),
        sequences=len(records),
        frames_seen=mean_over_scenes(records, lambda r: r.judgement.frames_seen / r.what.frames),
        lens_travel=mean_over_scenes(records, lambda r: r.judgement.lens_travel),
        time_to_focus_s=mean_over_scenes(records, lambda r: r.judgement.time_to_focus_s),
        reversals=mean_over_scenes(records, lambda r: r.judgement.reversals),
        hunting=mean_over_scenes(records, _hunts),
        windows=mean_over_scenes(records, lambda r: r.judgement.windows),
        seconds=mean_over_scenes(records, lambda r: r.judgement.seconds),
        operations=mean_over_scenes(records, lambda r: r.judgement.operations),
        over_declared=_over_declared(records),
        failed_check=next((r.who.failed_check for r in records if r.who.failed_check), None),
        success_least_blur=mean_over_scenes(records, _by_least_blur)
        if any(r.success_least_blur is not None for r in records)
        else None,
    )


def _sequences_of_known_sharpness(records: Sequence[Record]) -> set[str]:
    """Return the sequences on which no answer lacks its loss of sharpness, if any answer has one.

    Those without the region where a method looks state none there.
    """
    records = [r for r in records if r.what.obstacle != NO_INSIDE]
    if all(r.judgement.sharpness_lost is None for r in records):
        return set()
    lacking = {
        r.what.sequence for r in records if r.judgement.status == "answered" and r.judgement.sharpness_lost is None
    }
    return {r.what.sequence for r in records} - lacking


def _over_declared(records: Iterable[Record]) -> float | None:
    """Return the median of measured seconds over those of the declared operations, None for seconds that say nothing.

    The median leaves out the sequence for which a method is compiled, once on a machine.
    """
    timed = [r for r in records if r.judgement.operations and r.judgement.reference_rate]
    if not timed or median(r.judgement.seconds for r in timed) < LEAST_TIMED_S:
        return None
    return median(
        r.judgement.seconds * (r.judgement.reference_rate or 0.0) / (r.judgement.operations or 1.0) for r in timed
    )


def _by_least_blur(record: Record) -> float | None:
    if record.success_least_blur is None or not record.answerable:
        return right_within()(record)
    return float(record.success_least_blur)


def _hunts(record: Record) -> float | None:
    return None if record.judgement.reversals is None else float(record.judgement.reversals > TURNS_OF_A_PASS)


def method_intervals(by_method: Mapping[str, Sequence[Record]], outcomes: Outcomes) -> dict[str, MethodIntervals]:
    """Return the intervals of each method whose success is known.

    The unit is the scene, because all sequences of a scene show the same content. Except for rank intervals, each
    interval holds for one method, or one pair of methods, alone. A rank interval counts the rivals that are told apart
    from a method by a test of all rivals at once, so it does not become too narrow as their number grows.

    ``outcomes`` are those of the records in ``by_method``. With fewer than MIN_SCENES scenes, every interval is None.
    """
    if len(outcomes.scenes) < MIN_SCENES:
        reason = f"{len(outcomes.scenes)} of {MIN_SCENES} required scenes"
        return {method: MethodIntervals(missing_reason=reason) for method in outcomes.methods}
    fractions = outcomes.average_by_scene(outcomes.success)
    success = rate_intervals(fractions, outcomes.counts)
    wins = outcomes.find_wins()
    ranks = rank_intervals(wins, outcomes.counts)
    deficits = _find_deficits(fractions, wins, counts=outcomes.counts)
    answered = ~np.isnan(outcomes.errors)
    times = {
        method: mean_interval(list(mean_by_scene(by_method[method], lambda r: r.judgement.time_to_focus_s).values()))
        for method in outcomes.methods
    }
    return {
        method: MethodIntervals(
            success=(float(success[i, 0]), float(success[i, 1])),
            error=median_interval(outcomes.errors[i][answered[i]], outcomes.scene_of[answered[i]]),
            time=times[method],
            rank=(int(ranks[i, 0]), int(ranks[i, 1])),
            deficit_to_best=(float(deficits[i, 0]), float(deficits[i, 1])),
            level_with_best=bool(ranks[i, 0] == 1),
        )
        for i, method in enumerate(outcomes.methods)
    }


def rank_intervals(wins: np.ndarray, counts: np.ndarray, *, confidence: float = CONFIDENCE) -> np.ndarray:
    """Return the best and the worst rank that each method may have.

    A rival is told apart if its difference is too large for chance among all rivals of the row
    (adjust_p_values) and the interval of the difference excludes 0. The second condition protects against
    failures that are rare but clustered in a scene. The best rank is 1 plus the number of rivals told apart as better;
    the worst is the number of methods minus the rivals told apart as worse. Such confidence sets contain the true rank
    however many methods tie, whereas resampled ranks do not [1]_.

    Parameters
    ----------
    wins : ndarray of float, shape (M, M, S)
        Fraction of the sequences of each scene that method j solves and method k does not.
    counts : ndarray of int, shape (S,)
        Number of sequences in each scene.
    confidence : float, optional
        Probability, 0 to 1, with which the ranks of a row should contain the true rank.

    Returns
    -------
    ndarray of int, shape (M, 2)
        Best and worst rank of each method, 1 to M.

    References
    ----------
    .. [1] Mogstad, Romano, Shaikh, Wilhelm, "Inference for ranks with applications to mobility across neighbourhoods
       and academic achievement across countries", Review of Economic Studies 91(1), 2024, doi:10.1093/restud/rdad006.
    """
    methods = len(wins)
    differences = wins - wins.transpose(1, 0, 2)
    chance = np.stack([adjust_p_values(of_method) for of_method in differences])
    sure = _exclude_zero(wins, counts, among=chance <= 1 - confidence, confidence=confidence)
    worse = (sure & (differences.sum(axis=2) > 0)).sum(axis=1)
    better = (sure & (differences.sum(axis=2) < 0)).sum(axis=1)
    return np.stack([1 + better, methods - worse], axis=1)


def _exclude_zero(wins: np.ndarray, counts: np.ndarray, *, among: np.ndarray, confidence: float) -> np.ndarray:
    """Return the pairs in ``among`` for which the interval of the difference excludes 0: bool (M, M)."""
    found = np.zeros(among.shape, dtype=bool)
    first, second = np.nonzero(np.triu(among | among.T))
    if len(first):
        ends = difference_intervals(
            wins[first, second], wins[second, first], counts=counts, confidence=confidence, cells=COARSE
        )
        found[first, second] = found[second, first] = (ends[:, 0] > 0) | (ends[:, 1] < 0)
    return found & among


def _find_deficits(fractions: np.ndarray, wins: np.ndarray, *, counts: np.ndarray) -> np.ndarray:
    """Return the interval of each method's deficit to the nearest of the best methods, float (M, 2)."""
    means = fractions.mean(axis=1)
    best = np.flatnonzero(means >= means.max() - TIE_TOLERANCE)
    ends = np.stack([difference_intervals(wins[b], wins[:, b], counts=counts, cells=COARSE) for b in best])
    nearest = ends[ends[:, :, 0].argmin(axis=0), np.arange(len(means))]
    nearest[best] = 0
    return nearest


ERROR_LIMITS_DOF = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
TIMES = 12
"""Number of limits of a profile of times, evenly spaced up to the longest time of any method."""


@dataclass(frozen=True)
class Profile:
    """Performance profile of a method: the fraction of its answers within each limit, with 95 % intervals.

    Attributes
    ----------
    method : str
        Name of the method.
    quantity : str
        ``error_dof`` if the limits are absolute errors, in depths of focus. ``time_s``, in the closed loop, if they are
        times to focus, in seconds; only successes within one depth of focus are then counted.
    limits : tuple of float
        Limits in ascending order.
    fractions : tuple of float
        Fraction within each limit, 0 to 1.
    low, high : tuple of float or None
        Interval of each fraction, for that fraction alone; None for fewer than MIN_SCENES scenes.
    """

    method: str
    quantity: str
    limits: tuple[float, ...]
    fractions: tuple[float, ...]
    low: tuple[float, ...] | None
    high: tuple[float, ...] | None


@dataclass(frozen=True)
class NeighbourComparison:
    """Comparison of two methods that follow each other in the leaderboard, on the sequences that have an answer.

    Attributes
    ----------
    first, second : str
        Names of the methods, the better one first.
    difference, difference_low, difference_high : float
        Success rate within 1 DoF, first method minus second, with its 95 % interval.
    improvement, improvement_low, improvement_high : float
        Probability that the first method is nearer to the truth on a sequence, with its 95 % interval; ties count half.
        The ends of both intervals are None for fewer than MIN_SCENES scenes.
    told_apart : bool
        Whether the difference is too large for chance among all pairs of neighbours.
    """

    first: str
    second: str
    difference: float
    difference_low: float | None
    difference_high: float | None
    improvement: float
    improvement_low: float | None
    improvement_high: float | None
    told_apart: bool


@dataclass(frozen=True)
class MethodComparison:
    """The profiles of all methods and the comparisons of neighbours, both in the order of the leaderboard."""

    profiles: tuple[Profile, ...] = ()
    neighbours: tuple[NeighbourComparison, ...] = ()


def compare_methods(outcomes: Outcomes) -> MethodComparison:
    """Return the profiles of methods and the comparisons of neighbours in rank.

    Parameters
    ----------
    outcomes : Outcomes
        Outcomes of the methods in the order of the leaderboard.

    Returns
    -------
    MethodComparison
        Empty if the methods have no sequence of known success in common. Profiles of times are only made in the closed
        loop.
    """
    if not outcomes.scenes:
        return MethodComparison()
    profiles = _profile(outcomes, "error_dof", limits=ERROR_LIMITS_DOF, is_within=outcomes.answers_within)
    known = outcomes.times[np.isfinite(outcomes.times)]
    if outcomes.sequences[0].what.track == "closed_loop" and known.size:
        limits = tuple(float(t) for t in known.max() * np.arange(1, TIMES + 1) / TIMES)
        times = np.where(np.isfinite(outcomes.times), outcomes.times, limits[-1])  # neither looked nor moved
        profiles += _profile(
            outcomes,
            "time_s",
            limits=limits,
            is_within=lambda limit: outcomes.success & (times <= limit + TIE_TOLERANCE),
        )
    return MethodComparison(profiles, _compare_neighbours(outcomes))


def _profile(
    outcomes: Outcomes, quantity: str, *, limits: tuple[float, ...], is_within: Callable[[float], np.ndarray]
) -> tuple[Profile, ...]:
    by_scene = np.stack([outcomes.average_by_scene(is_within(limit)) for limit in limits], axis=1)  # (M, G, S)
    fractions, ends = by_scene.mean(axis=2), None
    if len(outcomes.scenes) >= MIN_SCENES:
        flat = by_scene.reshape(-1, by_scene.shape[2])
        ends = rate_intervals(flat, outcomes.counts, cells=COARSE).reshape(*fractions.shape, 2)
    return tuple(
        Profile(
            method,
            quantity,
            limits,
            tuple(fractions[i].tolist()),
            None if ends is None else tuple(ends[i, :, 0].tolist()),
            None if ends is None else tuple(ends[i, :, 1].tolist()),
        )
        for i, method in enumerate(outcomes.methods)
    )


def _compare_neighbours(outcomes: Outcomes) -> tuple[NeighbourComparison, ...]:
    if len(outcomes.methods) < 2:
        return ()
    errors = np.nan_to_num(outcomes.errors, nan=np.inf)
    first, second = outcomes.success[:-1], outcomes.success[1:]
    wins, losses = (outcomes.average_by_scene(one) for one in (first & ~second, ~first & second))
    with np.errstate(invalid="ignore"):
        nearer = errors[:-1] < errors[1:] - TIE_TOLERANCE
        farther = errors[:-1] > errors[1:] + TIE_TOLERANCE
    improved = outcomes.average_by_scene(nearer + 0.5 * ~(nearer | farther))
    ends = np.full((2, len(wins), 2), np.nan)
    are_told_apart = np.zeros(len(wins), dtype=bool)
    if len(outcomes.scenes) >= MIN_SCENES:
        ends[0] = difference_intervals(wins, losses, counts=outcomes.counts, cells=COARSE)
        ends[1] = rate_intervals(improved, outcomes.counts, cells=COARSE)
        excluded = (ends[0, :, 0] > 0) | (ends[0, :, 1] < 0)
        are_told_apart = excluded & (adjust_p_values(wins - losses) <= 1 - CONFIDENCE)
    (low, high), (improved_low, improved_high) = (
        [[None if np.isnan(end) else float(end) for end in side] for side in pairs.T] for pairs in ends
    )
    return tuple(
        NeighbourComparison(
            outcomes.methods[i],
            outcomes.methods[i + 1],
            float((wins[i] - losses[i]).mean()),
            low[i],
            high[i],
            float(improved[i].mean()),
            improved_low[i],
            improved_high[i],
            bool(are_told_apart[i]),
        )
        for i in range(len(wins))
    )
