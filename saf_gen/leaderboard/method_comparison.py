"""Methods beside each other beyond one limit of success: performance profiles, and neighbours in rank pair by pair.

Both are from Agarwal et al. (2021, arXiv:2108.13264), for sequences that share scenes: a rank asks how often an answer
is within one depth of focus, a profile asks it for every limit, and the probability of improvement is how often the one
method is nearer than the other. Fractions are averaged over lights, then over scenes, as success is, and their
intervals are those of success rates: of each figure alone. Whether neighbours are told apart is said of all at once.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from saf_gen.benchmark.records import Record
from saf_gen.leaderboard.outcomes import Outcomes, collect_outcomes_to_rank
from saf_gen.leaderboard.paired_tests import adjust_p_values_of_ranks
from saf_gen.leaderboard.scene_intervals import (
    COARSE,
    CONFIDENCE,
    MIN_SCENES,
    find_intervals_of_ranked_rate,
    find_rank_difference_intervals,
)

ERROR_LIMITS_DOF = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
TIMES = 12
"""Limits of a profile of times, evenly spaced up to the longest time of any method."""
_TIE = 1e-9


@dataclass(frozen=True)
class Profile:
    """The fractions of a method within each limit, with intervals; None for fewer than MIN_SCENES scenes.

    quantity : ``error_dof``, absolute errors in depths of focus, or in the closed loop ``time_s``: successes within one
        depth of focus whose lens had arrived by then.
    """

    method: str
    quantity: str
    limits: tuple[float, ...]
    fractions: tuple[float, ...]
    low: tuple[float, ...] | None
    high: tuple[float, ...] | None


@dataclass(frozen=True)
class NeighbourComparison:
    """Two methods that follow each other in the leaderboard; intervals are None for fewer than MIN_SCENES scenes.

    difference : success rate within 1 DoF of the first minus that of the second, with its 95 % interval.
    improvement : probability that the first is nearer to the truth on a sequence, ties counted half, with its interval.
    told_apart : whether the difference is too large for chance among all neighbours of the leaderboard.
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
    """The profiles of all methods and the pairs of neighbours, both in the order of the leaderboard."""

    profiles: tuple[Profile, ...] = ()
    neighbours: tuple[NeighbourComparison, ...] = ()


def compare_ranked_methods(records: Iterable[Record], methods: Sequence[str]) -> MethodComparison:
    """Return profiles and neighbours of these methods, which are in the order of the leaderboard.

    Methods whose success is not known are left out. The records are those of merge_ranked_records.
    """
    by_method: dict[str, list[Record]] = {method: [] for method in methods}
    is_closed_loop = False
    for record in records:
        by_method[record.method].append(record)
        is_closed_loop = is_closed_loop or record.track == "closed_loop"
    outcomes = collect_outcomes_to_rank(by_method)
    if not outcomes.methods:
        return MethodComparison()
    profiles = _profile(outcomes, "error_dof", limits=ERROR_LIMITS_DOF, is_within=outcomes.find_answers_within)
    known = outcomes.times[np.isfinite(outcomes.times)]
    if is_closed_loop and known.size:
        limits = tuple(float(t) for t in known.max() * np.arange(1, TIMES + 1) / TIMES)
        times = np.where(np.isfinite(outcomes.times), outcomes.times, limits[-1])  # an abstention that was right
        profiles += _profile(
            outcomes, "time_s", limits=limits, is_within=lambda limit: outcomes.success & (times <= limit + _TIE)
        )
    return MethodComparison(profiles, _compare_neighbours(outcomes))


def _profile(
    outcomes: Outcomes, quantity: str, *, limits: tuple[float, ...], is_within: Callable[[float], np.ndarray]
) -> tuple[Profile, ...]:
    shares = np.stack([outcomes.average_by_scene(is_within(limit)) for limit in limits], axis=1)  # (M, G, S)
    fractions, ends = shares.mean(axis=2), None
    if len(outcomes.scenes) >= MIN_SCENES:
        flat = shares.reshape(-1, shares.shape[2])
        ends = find_intervals_of_ranked_rate(flat, outcomes.counts, cells=COARSE).reshape(*fractions.shape, 2)
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
    errors = np.where(outcomes.abstained & outcomes.success, 0, np.nan_to_num(outcomes.errors, nan=np.inf))
    first, second = outcomes.success[:-1], outcomes.success[1:]
    wins, losses = (outcomes.average_by_scene(one) for one in (first & ~second, ~first & second))
    with np.errstate(invalid="ignore"):
        nearer = errors[:-1] < errors[1:] - _TIE
        farther = errors[:-1] > errors[1:] + _TIE
    improved = outcomes.average_by_scene(nearer + 0.5 * ~(nearer | farther))
    ends = np.full((2, len(wins), 2), np.nan)
    apart = np.zeros(len(wins), dtype=bool)
    if len(outcomes.scenes) >= MIN_SCENES:
        ends[0] = find_rank_difference_intervals(wins, losses, counts=outcomes.counts, cells=COARSE)
        ends[1] = find_intervals_of_ranked_rate(improved, outcomes.counts, cells=COARSE)
        excluded = (ends[0, :, 0] > 0) | (ends[0, :, 1] < 0)
        apart = excluded & (adjust_p_values_of_ranks(wins - losses) <= 1 - CONFIDENCE)
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
            bool(apart[i]),
        )
        for i in range(len(wins))
    )
