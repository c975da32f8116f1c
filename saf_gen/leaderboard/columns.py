"""What a row says, number by number: how each is named, explained and printed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Literal

from saf_gen.leaderboard.rows import LeaderboardRow
from saf_gen.leaderboard.statistics import TIE_TOLERANCE

__all__ = [
    "STANDARD_TERMINAL_WIDTH",
    "WIDE_TERMINAL_WIDTH",
    "Column",
    "format_percent",
    "list_all_columns",
    "list_shown_columns",
]

STANDARD_TERMINAL_WIDTH, WIDE_TERMINAL_WIDTH = 120, 200
"""Characters across that a terminal has room for intervals with, and for everything."""
ABSTAINED = "An abstention is right where no answer could lie so near, so this can be"


@dataclass(frozen=True)
class Column:
    """How one number of a row is named, explained and printed."""

    name: str
    header: str
    meaning: str
    value: Callable[[LeaderboardRow], Any]
    format_value: Callable[[LeaderboardRow], str]
    justify: Literal["left", "right"] = "right"
    group: str = ""
    """What the columns of a group share, for a table with room for a second line of headers."""
    min_terminal_width: int = 0
    """Left out of a terminal with fewer columns of characters; never of a file."""
    is_fraction: bool = False
    """A share of successes, 0...1."""
    is_optional: bool = False
    """Shown where a row knows it."""
    machine_only: bool = False
    """A number for programs: another column tells people."""
    light: str = ""
    """The light schedule that it is the share of, where it is of one alone."""

    @property
    def key(self) -> str:
        """What files call it: no two columns have the same, whatever a recipe calls its lights."""
        return f"success_1dof_light_{self.light}" if self.light else self.name


def list_shown_columns(rows: Sequence[LeaderboardRow]) -> tuple[Column, ...]:
    """The columns of these rows that people read, in order: one for each light schedule among them."""
    known = (
        c
        for c in list_all_columns(rows)
        if not c.is_optional or any(c.value(row) is not None for row in rows)
    )
    return tuple(c for c in known if not c.machine_only)


def list_all_columns(rows: Sequence[LeaderboardRow]) -> tuple[Column, ...]:
    """Every number of these rows, for files that programs read: whatever is known, the same ones."""
    lights = [light for light, _ in rows[0].success_by_light] if rows else []
    return (*_standing(), *_success(lights), *_errors(), *_unanswered(), *_cost())


def _standing() -> tuple[Column, ...]:
    rank = "Rank by success within 1 DoF; = marks a tie, ~ what the scenes cannot tell from the best."
    ranks = "Ranks it may hold on other scenes: 95 % of a bootstrap over scenes."
    lead = "What the best method has more of success within 1 DoF, scene by scene: 95 % interval."
    best, worst = _ends("rank_best", "rank_worst", "# 95 %", "", str, ranks)
    return (
        Column("rank", "#", rank, attrgetter("rank"), _rank),
        best,
        worst,
        _column("method", "method", "", str, "Focus measure + search.", justify="left"),
        _column(
            "level_with_best",
            "",
            "",
            str,
            "Whether the scenes cannot tell it from the best.",
            machine_only=True,
        ),
        *_ends("behind_best_low", "behind_best_high", "", "", format_percent, lead, machine_only=True),
    )


def _success(lights: Sequence[str]) -> tuple[Column, ...]:
    group, names = "success", ("success_1dof_low", "success_1dof_high")
    half = f"Share within ½ depth of focus: blur ≤ 1 px. {ABSTAINED} above ≤1 DoF."
    one = "Share within 1 DoF, blur ≤ 2 px: this ranks."
    two = f"Share within 2 DoF, blur ≤ 4 px. {ABSTAINED} below ≤1 DoF."
    interval = "95 % interval of the share within 1 DoF, from a bootstrap over scenes."
    return (
        _column(
            "success_half_dof",
            "≤½ DoF",
            group,
            format_percent,
            half,
            min_terminal_width=WIDE_TERMINAL_WIDTH,
            is_fraction=True,
        ),
        _column("success_1dof", "≤1 DoF", group, format_percent, one, is_fraction=True),
        *_ends(*names, "≤1 DoF 95 %", group, format_percent, interval),
        _column(
            "success_2dof",
            "≤2 DoF",
            group,
            format_percent,
            two,
            min_terminal_width=WIDE_TERMINAL_WIDTH,
            is_fraction=True,
        ),
        *(_light(light, "≤1 DoF by light") for light in lights),
    )


def _errors() -> tuple[Column, ...]:
    group, names = "error", ("median_error_dof_low", "median_error_dof_high")
    error, two, four = "Median |answer − truth| in depths of focus.", _fixed(2), _fixed(4)
    interval = "95 % interval of this median, from a bootstrap over scenes."
    travel, frames = "The same as a fraction of the travel.", "The same in frames of the recording."
    blur = "Median blur at the answer, pixels."
    return (
        _column("median_error_dof", "err DoF", group, two, error),
        *_ends(*names, "err DoF 95 %", group, two, interval, min_terminal_width=WIDE_TERMINAL_WIDTH),
        _column(
            "median_error_travel", "err travel", group, four, travel, min_terminal_width=WIDE_TERMINAL_WIDTH
        ),
        _column(
            "median_error_frames",
            "err frames",
            group,
            _fixed(0),
            frames,
            min_terminal_width=WIDE_TERMINAL_WIDTH,
            is_optional=True,
        ),
        _column("median_blur_px", "blur px", group, _fixed(1), blur, min_terminal_width=WIDE_TERMINAL_WIDTH),
    )


def _unanswered() -> tuple[Column, ...]:
    group = "no answer"
    abstained = "Sequences on which the search gave no answer."
    failed = "Sequences on which the method broke; the records say why."
    return (
        _column("abstained", "abst.", group, _count, abstained),
        _column("failed", "failed", group, _count, failed),
    )


def _cost() -> tuple[Column, ...]:
    group, two, three = "cost", _fixed(2), _fixed(3)
    seen = "Share of the frames that the method waited for."
    way = "Lens way in travels: as far as seen, then to the answer."
    turns = "How often a lens turned round that the method moved."
    until = "Seconds until the answer; of a recording without the lens's way to it."
    asked = "Scores that the search asked for."
    compute = "Seconds a sequence that the method computed, search and measure; counting is not in it."
    return (
        _column("frames_seen", "seen", group, format_percent, seen, min_terminal_width=WIDE_TERMINAL_WIDTH),
        _column("lens_travel", "lens", group, two, way),
        _column("reversals", "turns", group, _fixed(1), turns, is_optional=True),
        _column("time_to_focus_s", "to focus s", group, three, until, is_optional=True),
        _column("windows", "scores", group, _fixed(0), asked, min_terminal_width=WIDE_TERMINAL_WIDTH),
        _column("seconds", "s", group, three, compute, min_terminal_width=WIDE_TERMINAL_WIDTH),
    )


def format_percent(share: float) -> str:
    """A share as whole per cent."""
    return f"{share + TIE_TOLERANCE:.0%}"  # 0.375 is 38 %, whatever its last bit


def _column(
    name: str, header: str, group: str, show: Callable[[Any], str], meaning: str, **more: Any
) -> Column:
    """A column of the row's attribute ``name``."""
    value = attrgetter(name)

    def text(row: LeaderboardRow) -> str:
        held = value(row)
        return "–" if held is None else show(held)

    return Column(name, header, meaning, value, text, group=group, **more)


def _ends(
    low: str, high: str, header: str, group: str, show: Callable[[Any], str], meaning: str, **more: Any
) -> tuple[Column, Column]:
    """Both ends of an interval: the column of the first shows them, that of the second is for programs."""

    def text(row: LeaderboardRow) -> str:
        ends = getattr(row, low), getattr(row, high)
        return "–" if None in ends else "–".join(map(show, ends))

    more = {"min_terminal_width": STANDARD_TERMINAL_WIDTH, "is_optional": True, **more}
    first = Column(low, header, meaning, attrgetter(low), text, group=group, **more)
    return first, _column(high, "", group, show, "Its upper end.", machine_only=True)


def _light(light: str, group: str) -> Column:
    def value(row: LeaderboardRow) -> float | None:
        return dict(row.success_by_light).get(light)

    def text(row: LeaderboardRow) -> str:
        share = value(row)
        return "–" if share is None else format_percent(share)

    meaning = f"Share within 1 DoF under the light {light}."
    return Column(
        f"success_1dof_{light}", light, meaning, value, text, group=group, is_fraction=True, light=light
    )


def _rank(row: LeaderboardRow) -> str:
    if row.rank is None:
        return "–"
    level = "~" if row.level_with_best and row.rank > 1 else ""
    return f"{row.rank}{'=' if row.tied else ''}{level}"


def _count(number: int) -> str:
    return str(number) if number else "–"


def _fixed(digits: int) -> Callable[[float], str]:
    return lambda number: f"{number:.{digits}f}"
