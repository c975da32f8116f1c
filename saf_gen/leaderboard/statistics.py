"""Confidence intervals of a ranking: of success, error, time, the difference to the best, and ranks.

The scene is the unit, because all sequences of a scene show the same content. Every interval but those of ranks holds
for one method, or one pair of methods, alone. The interval of a rank counts the methods that are told apart from the
row's among all its rivals at once, so that it does not grow falsely narrow with their number.
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
"""Largest difference between equal successes: averages of averages may differ in the last bit."""


@dataclass(frozen=True)
class MethodIntervals:
    """Intervals of one method among the others; None means unknown, and ``missing_reason`` says why."""

    success: Interval | None = None
    error: Interval | None = None
    """Interval of the median error."""
    time: Interval | None = None
    """Interval of the mean time to focus."""
    rank: tuple[int, int] | None = None
    """Best and worst rank."""
    deficit_to_best: Interval | None = None
    """Success of the best method minus the method's own; of several best ones, the nearest counts."""
    level_with_best: bool | None = None
    """Whether no method is told apart from this one as a better one: its ``rank`` may be the first."""
    missing_reason: str = ""


def find_intervals_of_ranking(by_method: Mapping[str, Sequence[Record]]) -> dict[str, MethodIntervals]:
    """Return the intervals of each method whose success is known.

    The records are those that merge_leaderboard_records lets pass.
    """
    outcomes = collect_outcomes_to_rank(by_method)
    if len(outcomes.scenes) < MIN_SCENES:
        reason = f"{len(outcomes.scenes)} of at least {MIN_SCENES} scenes"
        return {method: MethodIntervals(missing_reason=reason) for method in outcomes.methods}
    shares = outcomes.average_by_scene(outcomes.success)
    success = find_intervals_of_ranked_rate(shares, outcomes.counts)
    wins = outcomes.find_wins()
    ranks = find_rank_intervals(wins, outcomes.counts)
    deficits = _find_deficits(shares, wins, counts=outcomes.counts)
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
    """Return the best and the worst rank that each method may have: int (M, 2).

    A rival is told apart where its difference is too large for chance among all rivals of the row
    (adjust_p_values_of_ranks) and the interval of the difference leaves out 0, which also holds where failures are rare
    and come many in a scene.
    The best rank comes after the better ones, the worst before the worse ones; confidence sets of this kind hold the
    true rank however many methods tie, where resampled ranks do not [1]_.

    Parameters
    ----------
    wins : float (M, M, S), the fraction of each scene's sequences that method j solves and method k does not.
    counts : int (S,), sequences in each scene.

    References
    ----------
    .. [1] Mogstad, Romano, Shaikh, Wilhelm, "Inference for ranks with applications to mobility across neighbourhoods
       and academic achievement across countries", Review of Economic Studies 91(1), 2024, doi:10.1093/restud/rdad006.
    """
    methods = len(wins)
    differences = wins - wins.transpose(1, 0, 2)
    chance = np.stack([adjust_p_values_of_ranks(own) for own in differences])
    sure = _exclude_zero(wins, counts, among=chance <= 1 - confidence, confidence=confidence)
    worse = (sure & (differences.sum(axis=2) > 0)).sum(axis=1)
    better = (sure & (differences.sum(axis=2) < 0)).sum(axis=1)
    return np.stack([1 + better, methods - worse], axis=1)


def _exclude_zero(wins: np.ndarray, counts: np.ndarray, *, among: np.ndarray, confidence: float) -> np.ndarray:
    """Return which of these pairs have a difference whose interval leaves out 0: bool (M, M)."""
    found = np.zeros(among.shape, dtype=bool)
    first, second = np.nonzero(np.triu(among | among.T))
    if len(first):
        ends = find_rank_difference_intervals(
            wins[first, second], wins[second, first], counts=counts, confidence=confidence, cells=COARSE
        )
        found[first, second] = found[second, first] = (ends[:, 0] > 0) | (ends[:, 1] < 0)
    return found & among


def _find_deficits(shares: np.ndarray, wins: np.ndarray, *, counts: np.ndarray) -> np.ndarray:
    """Return the intervals of the differences to the nearest of the best methods: float (M, 2)."""
    means = shares.mean(axis=1)
    best = np.flatnonzero(means >= means.max() - TIE_TOLERANCE)
    ends = np.stack([find_rank_difference_intervals(wins[b], wins[:, b], counts=counts, cells=COARSE) for b in best])
    nearest = ends[ends[:, :, 0].argmin(axis=0), np.arange(len(means))]
    nearest[best] = 0
    return nearest
