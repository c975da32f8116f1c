"""Comparison of methods beyond a single limit of success: performance profiles, and pairs of neighbours in rank.

Both follow Agarwal et al. (2021, arXiv:2108.13264), adapted to sequences that share scenes. A rank depends on the
fraction of answers within one depth of focus; a profile gives this fraction for many limits. The probability of
improvement is the fraction of sequences on which one method is nearer to the truth than the other. All are over the
sequences that have an answer. Like success, fractions are averaged over lights, then over scenes. Their intervals are
computed like those of success rates, and each holds alone. The test that tells neighbours apart covers all pairs of
neighbours at once.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from saf_gen.leaderboard.intervals import (
    COARSE,
    CONFIDENCE,
    MIN_SCENES,
    adjust_p_values,
    difference_intervals,
    rate_intervals,
)
from saf_gen.leaderboard.outcomes import Outcomes

ERROR_LIMITS_DOF = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
TIMES = 12
"""Number of limits of a profile of times, evenly spaced up to the longest time of any method."""
_TIE = 1e-9


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
    if outcomes.sequences[0].track == "closed_loop" and known.size:
        limits = tuple(float(t) for t in known.max() * np.arange(1, TIMES + 1) / TIMES)
        times = np.where(np.isfinite(outcomes.times), outcomes.times, limits[-1])  # neither looked nor moved
        profiles += _profile(
            outcomes, "time_s", limits=limits, is_within=lambda limit: outcomes.success & (times <= limit + _TIE)
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
        nearer = errors[:-1] < errors[1:] - _TIE
        farther = errors[:-1] > errors[1:] + _TIE
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
