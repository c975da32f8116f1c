"""Confidence intervals of a ranking: of success, error, time, difference to the best method, and rank.

The unit is the scene, because all sequences of a scene show the same content. Except for rank intervals, each
interval holds for one method, or one pair of methods, alone. A rank interval counts the rivals that are told apart from
a method by a test of all rivals at once, so it does not become too narrow as their number grows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from saf_gen.benchmark.records import Record
from saf_gen.leaderboard.averages import mean_by_scene_for_ranking
from saf_gen.leaderboard.outcomes import collect_outcomes_to_rank
from saf_gen.leaderboard.paired_tests import adjust_p_values_of_ranks
from saf_gen.leaderboard.scene_intervals import (
    COARSE,
    CONFIDENCE,
    MIN_SCENES,
    Interval,
    find_interval_of_ranked_mean,
    find_interval_of_ranked_median,
    find_intervals_of_ranked_rate,
    find_rank_difference_intervals,
)

TIE_TOLERANCE = 1e-9
"""Largest difference at which two success rates count as equal; averages of averages may differ in the last bit."""


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


def find_intervals_of_ranking(by_method: Mapping[str, Sequence[Record]]) -> dict[str, MethodIntervals]:
    """Return the intervals of each method whose success is known.

    ``by_method`` holds records that merge_leaderboard_records has accepted. With fewer than MIN_SCENES scenes, every
    interval is None.
    """
    outcomes = collect_outcomes_to_rank(by_method)
    if len(outcomes.scenes) < MIN_SCENES:
        reason = f"{len(outcomes.scenes)} of {MIN_SCENES} required scenes"
        return {method: MethodIntervals(missing_reason=reason) for method in outcomes.methods}
    fractions = outcomes.average_by_scene(outcomes.success)
    success = find_intervals_of_ranked_rate(fractions, outcomes.counts)
    wins = outcomes.find_wins()
    ranks = find_rank_intervals(wins, outcomes.counts)
    deficits = _find_deficits(fractions, wins, counts=outcomes.counts)
    answered = ~np.isnan(outcomes.errors)
    times = {
        method: find_interval_of_ranked_mean(
            list(mean_by_scene_for_ranking(by_method[method], lambda r: r.time_to_focus_s).values())
        )
        for method in outcomes.methods
    }
    return {
        method: MethodIntervals(
            success=(float(success[i, 0]), float(success[i, 1])),
            error=find_interval_of_ranked_median(outcomes.errors[i][answered[i]], outcomes.scene_of[answered[i]]),
            time=times[method],
            rank=(int(ranks[i, 0]), int(ranks[i, 1])),
            deficit_to_best=(float(deficits[i, 0]), float(deficits[i, 1])),
            level_with_best=bool(ranks[i, 0] == 1),
        )
        for i, method in enumerate(outcomes.methods)
    }


def find_rank_intervals(wins: np.ndarray, counts: np.ndarray, *, confidence: float = CONFIDENCE) -> np.ndarray:
    """Return the best and the worst rank that each method may have.

    A rival is told apart if its difference is too large for chance among all rivals of the row
    (adjust_p_values_of_ranks) and the interval of the difference excludes 0. The second condition protects against
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
    chance = np.stack([adjust_p_values_of_ranks(of_method) for of_method in differences])
    sure = _exclude_zero(wins, counts, among=chance <= 1 - confidence, confidence=confidence)
    worse = (sure & (differences.sum(axis=2) > 0)).sum(axis=1)
    better = (sure & (differences.sum(axis=2) < 0)).sum(axis=1)
    return np.stack([1 + better, methods - worse], axis=1)


def _exclude_zero(wins: np.ndarray, counts: np.ndarray, *, among: np.ndarray, confidence: float) -> np.ndarray:
    """Return the pairs in ``among`` for which the interval of the difference excludes 0: bool (M, M)."""
    found = np.zeros(among.shape, dtype=bool)
    first, second = np.nonzero(np.triu(among | among.T))
    if len(first):
        ends = find_rank_difference_intervals(
            wins[first, second], wins[second, first], counts=counts, confidence=confidence, cells=COARSE
        )
        found[first, second] = found[second, first] = (ends[:, 0] > 0) | (ends[:, 1] < 0)
    return found & among


def _find_deficits(fractions: np.ndarray, wins: np.ndarray, *, counts: np.ndarray) -> np.ndarray:
    """Return the interval of each method's deficit to the nearest of the best methods, float (M, 2)."""
    means = fractions.mean(axis=1)
    best = np.flatnonzero(means >= means.max() - TIE_TOLERANCE)
    ends = np.stack([find_rank_difference_intervals(wins[b], wins[:, b], counts=counts, cells=COARSE) for b in best])
    nearest = ends[ends[:, :, 0].argmin(axis=0), np.arange(len(means))]
    nearest[best] = 0
    return nearest
