"""The rows of the leaderboard: one per method, best first."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

from saf_gen.benchmark.records import Record
from saf_gen.leaderboard.averages import mean_over_scenes_for_ranking, median_magnitude_for_ranking
from saf_gen.leaderboard.merging import merge_leaderboard_records
from saf_gen.leaderboard.ranking_intervals import TIE_TOLERANCE, MethodIntervals, find_intervals_of_ranking

TURNS_OF_A_PASS = 2
"""Reversals of a lens that goes to one end of its travel, sweeps to the other end, and returns to the answer."""


@dataclass(frozen=True)
class LeaderboardRow:
    """One method of the leaderboard; a number is None if no sequence has the truth that it needs."""

    rank: int | None
    tied: tuple[str, ...]
    """The other methods with the same rank."""
    method: str
    success_half_dof: float | None
    success_1dof: float | None
    success_2dof: float | None
    median_error_dof: float | None
    median_error_travel: float | None
    median_error_frames: float | None
    median_blur_px: float | None
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
    success_1dof_low: float | None = None
    success_1dof_high: float | None = None
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


def rank_methods(records: Iterable[Record]) -> tuple[LeaderboardRow, ...]:
    """Return the leaderboard of these records, best first.

    Methods are ranked by success within one depth of focus. Rows of equal rank are ordered by median error in depths of
    focus, then by name. Methods for which no success is known come last and have no rank.

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
        If the records cannot be compared: see merge_leaderboard_records.
    """
    by_method: dict[str, list[Record]] = {}
    for record in merge_leaderboard_records({"": list(records)}):
        by_method.setdefault(record.method, []).append(record)
    lights = sorted({r.light for group in by_method.values() for r in group if r.light is not None})
    rows = [_average(method, group, lights=lights) for method, group in by_method.items()]
    intervals = find_intervals_of_ranking(by_method)
    best = max((row.success_1dof for row in rows if row.success_1dof is not None), default=0.0)
    ranked = [_add_intervals(_rank(row, rows), intervals.get(row.method), best=best) for row in rows]
    return tuple(sorted(ranked, key=_sort_key))


def _sort_key(row: LeaderboardRow) -> tuple[float, float, str]:
    error = row.median_error_dof
    return inf if row.rank is None else row.rank, inf if error is None else error, row.method


def _rank(row: LeaderboardRow, rows: Sequence[LeaderboardRow]) -> LeaderboardRow:
    rate = row.success_1dof
    if rate is None:
        return row
    others = {r.method: r.success_1dof for r in rows if r.success_1dof is not None and r is not row}
    tied = sorted(method for method, success in others.items() if abs(success - rate) <= TIE_TOLERANCE)
    rank = 1 + sum(success > rate + TIE_TOLERANCE for success in others.values())
    return replace(row, rank=rank, tied=tuple(tied))


def _add_intervals(row: LeaderboardRow, intervals: MethodIntervals | None, *, best: float) -> LeaderboardRow:
    """Return a ranked row with its intervals; ``best`` is the success rate of the best method."""
    if intervals is None or row.success_1dof is None:
        return row
    pairs = {
        ("success_1dof_low", "success_1dof_high"): (row.success_1dof, intervals.success),
        ("median_error_dof_low", "median_error_dof_high"): (row.median_error_dof, intervals.error),
        ("time_to_focus_low_s", "time_to_focus_high_s"): (row.time_to_focus_s, intervals.time),
        ("rank_best", "rank_worst"): (row.rank, intervals.rank),
        ("behind_best_low", "behind_best_high"): (best - row.success_1dof, intervals.deficit_to_best),
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


def _average(method: str, records: Sequence[Record], *, lights: Sequence[str]) -> LeaderboardRow:
    """Return the row of a method without rank and intervals, with its success under each of the ``lights``."""
    return LeaderboardRow(
        rank=None,
        tied=(),
        method=method,
        success_half_dof=mean_over_scenes_for_ranking(records, lambda r: r.success_half_dof),
        success_1dof=mean_over_scenes_for_ranking(records, lambda r: r.success_1dof),
        success_2dof=mean_over_scenes_for_ranking(records, lambda r: r.success_2dof),
        median_error_dof=median_magnitude_for_ranking(r.error_dof for r in records),
        median_error_travel=median_magnitude_for_ranking(r.error for r in records),
        median_error_frames=median_magnitude_for_ranking(r.error_frames for r in records),
        median_blur_px=median_magnitude_for_ranking(r.blur_px for r in records),
        success_by_light=tuple(
            (light, mean_over_scenes_for_ranking([r for r in records if r.light == light], lambda r: r.success_1dof))
            for light in lights
        ),
        abstained=sum(r.status == "abstained" for r in records),
        failed=sum(r.status == "failed" for r in records),
        sequences=len(records),
        frames_seen=mean_over_scenes_for_ranking(records, lambda r: r.frames_seen / r.frames),
        lens_travel=mean_over_scenes_for_ranking(records, lambda r: r.lens_travel),
        time_to_focus_s=mean_over_scenes_for_ranking(records, lambda r: r.time_to_focus_s),
        reversals=mean_over_scenes_for_ranking(records, lambda r: r.reversals),
        hunting=mean_over_scenes_for_ranking(records, _hunts),
        windows=mean_over_scenes_for_ranking(records, lambda r: r.windows),
        seconds=mean_over_scenes_for_ranking(records, lambda r: r.seconds),
    )


def _hunts(record: Record) -> float | None:
    return None if record.reversals is None else float(record.reversals > TURNS_OF_A_PASS)
