"""Methods in their order: one row each."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from saf_gen.benchmark.records import Record
from saf_gen.leaderboard.averages import mean_by_scene, mean_over_scenes, median_magnitude
from saf_gen.leaderboard.merging import merge_records
from saf_gen.leaderboard.statistics import TIE_TOLERANCE, BootstrapIntervals, bootstrap_intervals

__all__ = ["LeaderboardRow", "rank_methods"]


@dataclass(frozen=True)
class LeaderboardRow:
    """One method of the leaderboard. None is unknown: no sequence has the truth that it needs."""

    rank: int | None
    tied: tuple[str, ...]
    """The methods that share the rank."""
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
    windows: float | None
    seconds: float | None
    success_1dof_low: float | None = None
    success_1dof_high: float | None = None
    median_error_dof_low: float | None = None
    median_error_dof_high: float | None = None
    rank_best: int | None = None
    rank_worst: int | None = None
    behind_best_low: float | None = None
    behind_best_high: float | None = None
    level_with_best: bool | None = None
    missing_reason: str = ""
    """Why there are no intervals (see statistics.BootstrapIntervals, of which these nine are), else ''."""


def rank_methods(records: Iterable[Record]) -> tuple[LeaderboardRow, ...]:
    """The leaderboard of these records, best first.

    Within a rank rows stand by median error in depths of focus, then by name. Methods without any
    success to judge come last, with no rank.

    Raises BadInput where records cannot be compared: see merge_records.
    """
    by_method: dict[str, list[Record]] = {}
    for record in merge_records({"": list(records)}):
        by_method.setdefault(record.method, []).append(record)
    lights = sorted({r.light for mine in by_method.values() for r in mine if r.light is not None})
    rows = [_row(method, mine, lights) for method, mine in by_method.items()]
    standing = _standings(by_method)
    last = float("inf")
    return tuple(
        sorted(
            (
                replace(_ranked(row, rows), **_ends(standing.get(row.method, BootstrapIntervals())))
                for row in rows
            ),
            key=lambda r: (
                last if r.rank is None else r.rank,
                last if r.median_error_dof is None else r.median_error_dof,
                r.method,
            ),
        )
    )


def _ranked(row: LeaderboardRow, rows: Sequence[LeaderboardRow]) -> LeaderboardRow:
    own = row.success_1dof
    if own is None:
        return row
    others = {r.method: r.success_1dof for r in rows if r.success_1dof is not None and r is not row}
    tied = sorted(method for method, share in others.items() if abs(share - own) <= TIE_TOLERANCE)
    return replace(
        row, rank=1 + sum(share > own + TIE_TOLERANCE for share in others.values()), tied=tuple(tied)
    )


def _standings(by_method: dict[str, list[Record]]) -> dict[str, BootstrapIntervals]:
    success = {method: mean_by_scene(mine, lambda r: r.success_1dof) for method, mine in by_method.items()}
    return bootstrap_intervals(
        {method: cells for method, cells in success.items() if cells},
        {
            method: [(r.scene, abs(r.error_dof)) for r in mine if r.error_dof is not None]
            for method, mine in by_method.items()
        },
    )


def _ends(standing: BootstrapIntervals) -> dict[str, Any]:
    intervals = {
        ("success_1dof_low", "success_1dof_high"): standing.success,
        ("median_error_dof_low", "median_error_dof_high"): standing.error,
        ("rank_best", "rank_worst"): standing.rank,
        ("behind_best_low", "behind_best_high"): standing.deficit_to_best,
    }
    ends = {
        name: end
        for names, held in intervals.items()
        for name, end in zip(names, held or (None,) * 2, strict=True)
    }
    return {**ends, "level_with_best": standing.level_with_best, "missing_reason": standing.missing_reason}


def _row(method: str, records: Sequence[Record], lights: Sequence[str]) -> LeaderboardRow:
    return LeaderboardRow(
        rank=None,
        tied=(),
        method=method,
        success_half_dof=mean_over_scenes(records, lambda r: r.success_half_dof),
        success_1dof=mean_over_scenes(records, lambda r: r.success_1dof),
        success_2dof=mean_over_scenes(records, lambda r: r.success_2dof),
        median_error_dof=median_magnitude(r.error_dof for r in records),
        median_error_travel=median_magnitude(r.error for r in records),
        median_error_frames=median_magnitude(r.error_frames for r in records),
        median_blur_px=median_magnitude(r.blur_px for r in records),
        success_by_light=tuple(
            (light, mean_over_scenes([r for r in records if r.light == light], lambda r: r.success_1dof))
            for light in lights
        ),
        abstained=sum(r.status == "abstained" for r in records),
        failed=sum(r.status == "failed" for r in records),
        sequences=len(records),
        frames_seen=mean_over_scenes(records, lambda r: r.frames_seen / r.frames),
        lens_travel=mean_over_scenes(records, lambda r: r.lens_travel),
        time_to_focus_s=mean_over_scenes(records, lambda r: r.time_to_focus_s),
        reversals=mean_over_scenes(records, lambda r: r.reversals),
        windows=mean_over_scenes(records, lambda r: r.windows),
        seconds=mean_over_scenes(records, lambda r: r.seconds),
    )
