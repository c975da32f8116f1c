"""The columns of the leaderboard: name, meaning, value and text of each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Literal

from saf_gen.leaderboard.ranking_intervals import TIE_TOLERANCE
from saf_gen.leaderboard.rows import LeaderboardRow

ESSENTIAL, USUAL, INTERVALS, ALL = range(4)
"""Levels of detail of a column; if space is short, columns of the highest level are left out first."""
_ALL: dict[str, Any] = {"detail": ALL}
_ESSENTIAL: dict[str, Any] = {"detail": ESSENTIAL}


@dataclass(frozen=True)
class Column:
    """A column: its name, heading and meaning, and functions that return the value and the text for a row."""

    name: str
    header: str
    meaning: str
    value: Callable[[LeaderboardRow], Any]
    format_value: Callable[[LeaderboardRow], str]
    justify: Literal["left", "right"] = "right"
    group: str = ""
    """Common heading of adjacent columns, for tables with two lines of headings."""
    detail: int = USUAL
    """Level of detail; leaderboard.json, .csv and .md have columns of all levels."""
    is_fraction: bool = False
    """Whether the value is a fraction of successes, 0–1."""
    is_optional: bool = False
    """Whether the column is shown only if its value is known in at least one row."""
    machine_only: bool = False
    """Whether tables for readers leave the column out."""
    light: str = ""
    """Light schedule to which the column is restricted; '' if it is not restricted."""

    @property
    def key(self) -> str:
        """Name of the column in files, unique whatever a recipe calls its lights."""
        return f"success_1dof_light_{self.light}" if self.light else self.name


def list_shown_leaderboard_columns(rows: Sequence[LeaderboardRow]) -> tuple[Column, ...]:
    """Return the columns of tables for readers, in order, including one per light schedule.

    Columns for programs and optional columns without a known value are left out.
    """
    return tuple(
        c
        for c in list_leaderboard_columns(rows)
        if not c.machine_only and (not c.is_optional or any(c.value(row) is not None for row in rows))
    )


def list_leaderboard_columns(rows: Sequence[LeaderboardRow]) -> tuple[Column, ...]:
    """Return all columns, in order, including one per light schedule, whether or not their values are known."""
    lights = [light for light, _ in rows[0].success_by_light] if rows else []
    return (*_rank_columns(), *_success_columns(lights), *_error_columns(), *_count_columns(), *_cost_columns())


def format_leaderboard_percent(fraction: float) -> str:
    """Return a fraction as a percentage without decimals; halves are rounded up."""
    return f"{fraction + TIE_TOLERANCE:.0%}"  # 0.375 becomes 38 % even if rounding makes it slightly smaller


def _rank_columns() -> tuple[Column, ...]:
    rank = "Rank by success within 1 DoF; = marks a tie, ~ a method that cannot be told apart from any better one."
    ranks = "95 % interval of the rank over all scenes of this kind, for all rivals at once."
    level = "Whether no better method can be told apart from this one."
    deficit = "Success within 1 DoF of the best method minus that of this method: 95 % interval of this pair alone."
    ends = "behind_best_low", "behind_best_high"
    verified = "Whether a repeated run gave the same answers: see saf-gen leaderboard verify."
    return (
        Column("rank", "#", rank, attrgetter("rank"), _format_rank, **_ESSENTIAL),
        *_interval_columns("rank_best", "rank_worst", header="# 95 %", meaning=ranks, text=str),
        _column("method", "method", meaning="Focus measure + search.", text=str, justify="left", **_ESSENTIAL),
        _column("verified", "verified", meaning=verified, text=str, justify="left", is_optional=True),
        _column("level_with_best", "", meaning=level, text=str, machine_only=True),
        *_interval_columns(*ends, header="", meaning=deficit, text=format_leaderboard_percent, machine_only=True),
    )


def _success_columns(lights: Sequence[str]) -> tuple[Column, ...]:
    abstention = "An abstention is right if no answer could be that near, so the value can be"
    half = f"Success within ½ depth of focus: blur ≤ 1 px. {abstention} higher than ≤1 DoF."
    one = "Success within 1 DoF: blur ≤ 2 px. Methods are ranked by it."
    two = f"Success within 2 DoF: blur ≤ 4 px. {abstention} lower than ≤1 DoF."
    interval = "95 % interval of success within 1 DoF over all scenes of this kind."
    ends = "success_1dof_low", "success_1dof_high"
    options: dict[str, Any] = {"text": format_leaderboard_percent, "group": "success"}
    return (
        _column("success_half_dof", "≤½ DoF", meaning=half, is_fraction=True, **options, **_ALL),
        _column("success_1dof", "≤1 DoF", meaning=one, is_fraction=True, **options, **_ESSENTIAL),
        *_interval_columns(*ends, header="≤1 DoF 95 %", meaning=interval, **options),
        _column("success_2dof", "≤2 DoF", meaning=two, is_fraction=True, **options, **_ALL),
        *map(_light_column, lights),
    )


def _light_column(light: str) -> Column:
    def value(row: LeaderboardRow) -> float | None:
        return dict(row.success_by_light).get(light)

    def text(row: LeaderboardRow) -> str:
        return "–" if (fraction := value(row)) is None else format_leaderboard_percent(fraction)

    meaning = f"Success within 1 DoF under the light {light}."
    group = "≤1 DoF by light"
    return Column(f"success_1dof_{light}", light, meaning, value, text, group=group, is_fraction=True, light=light)


def _error_columns() -> tuple[Column, ...]:
    error = "Median |answer − truth| in depths of focus."
    interval = "95 % interval of the median error over all scenes of this kind."
    travel = "Median |answer − truth| as a fraction of the travel."
    frames = "Median |answer − truth| in frames of the recording."
    blur = "Median blur at the answer, in pixels."
    ends = "median_error_dof_low", "median_error_dof_high"
    two: dict[str, Any] = {"text": _fixed(2), "group": "error"}
    four: dict[str, Any] = {"text": _fixed(4), "group": "error", **_ALL}
    whole_frames: dict[str, Any] = {"text": _fixed(0), "group": "error", **_ALL, "is_optional": True}
    return (
        _column("median_error_dof", "err DoF", meaning=error, **two, **_ESSENTIAL),
        *_interval_columns(*ends, header="err DoF 95 %", meaning=interval, **{**two, **_ALL}),
        _column("median_error_travel", "err travel", meaning=travel, **four),
        _column("median_error_frames", "err frames", meaning=frames, **whole_frames),
        _column("median_blur_px", "blur px", meaning=blur, **{**four, "text": _fixed(1)}),
    )


def _count_columns() -> tuple[Column, ...]:
    abstained = "Number of sequences on which the search abstained."
    failed = "Number of sequences on which the method raised an error; the records name the error."
    options: dict[str, Any] = {"text": lambda number: str(number or "–"), "group": "no answer"}
    return (
        _column("abstained", "abst.", meaning=abstained, **options),
        _column("failed", "failed", meaning=failed, **options),
    )


def _cost_columns() -> tuple[Column, ...]:
    seen = "Number of frames that the method waited for, divided by all frames of the sequence."
    travel = "Distance that the lens moves, in travels, during the frames seen and then to the answer."
    reversals = "Number of times that the lens reversed, if the method moves it."
    hunting = "Fraction of sequences in which the lens reversed more than twice; a pass and return takes two."
    until = "Seconds until the answer; on a recording, without the final move of the lens."
    mean = "95 % interval of the mean time until the answer over all scenes of this kind."
    ends = "time_to_focus_low_s", "time_to_focus_high_s"
    scores = "Number of scores that the search requested."
    seconds = "Computing time of search and measure per sequence, in seconds, without the counting of spikes."
    two, three = _fixed(2), _fixed(3)
    return (
        _column("frames_seen", "seen", meaning=seen, text=format_leaderboard_percent, group="cost", **_ALL),
        _column("lens_travel", "lens", meaning=travel, text=two, group="cost"),
        _column("reversals", "turns", meaning=reversals, text=_fixed(1), group="cost", is_optional=True),
        _column("hunting", "hunts", meaning=hunting, text=format_leaderboard_percent, group="cost", is_optional=True),
        _column("time_to_focus_s", "to focus s", meaning=until, text=three, group="cost", is_optional=True),
        *_interval_columns(*ends, header="to focus s 95 %", meaning=mean, text=three, group="cost", detail=ALL),
        _column("windows", "scores", meaning=scores, text=_fixed(0), group="cost", **_ALL),
        _column("seconds", "s", meaning=seconds, text=three, group="cost", **_ALL),
    )


def _column(name: str, header: str, *, meaning: str, text: Callable[[Any], str], **options: Any) -> Column:
    """Return the column of the attribute ``name`` of a row; ``text`` formats a known value."""
    value = attrgetter(name)

    def format_value(row: LeaderboardRow) -> str:
        return "–" if (number := value(row)) is None else text(number)

    return Column(name, header, meaning, value, format_value, **options)


def _interval_columns(
    low: str, high: str, *, header: str, meaning: str, text: Callable[[Any], str], **options: Any
) -> tuple[Column, Column]:
    """Return the columns of both ends of an interval; the text of the first has both, the second is for programs."""

    def format_value(row: LeaderboardRow) -> str:
        ends = getattr(row, low), getattr(row, high)
        return "–" if None in ends else "–".join(map(text, ends))

    options = {"detail": INTERVALS, "is_optional": True, **options}
    upper = _column(high, "", meaning="Upper end of the interval.", text=text, machine_only=True)
    return Column(low, header, meaning, attrgetter(low), format_value, **options), upper


def _format_rank(row: LeaderboardRow) -> str:
    if row.rank is None:
        return "–"
    level = "~" if row.level_with_best and row.rank > 1 else ""
    return f"{row.rank}{'=' if row.tied else ''}{level}"


def _fixed(digits: int) -> Callable[[float], str]:
    return lambda number: f"{number:.{digits}f}"
