"""What a row says, number by number: how each is named, explained and printed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Literal

from saf_gen.leaderboard.rows import Row
from saf_gen.statistics import TIE

__all__ = ["USUAL", "WIDE", "Column", "columns", "numbers", "percent"]

USUAL, WIDE = 120, 200
"""Characters across that a terminal has room for intervals with, and for everything."""
ABSTAINED = "An abstention is right where no answer could lie so near, so this can be"


@dataclass(frozen=True)
class Column:
    """How one number of a row is named, explained and printed."""

    name: str
    header: str
    meaning: str
    value: Callable[[Row], Any]
    text: Callable[[Row], str]
    justify: Literal["left", "right"] = "right"
    group: str = ""
    """What the columns of a group share, for a table with room for a second line of headers."""
    room: int = 0
    """Left out of a terminal with fewer columns of characters; never of a file."""
    share: bool = False
    """A share of successes, 0...1."""
    rare: bool = False
    """Shown where a row knows it."""
    hidden: bool = False
    """A number for programs: another column tells people."""
    light: str = ""
    """The light schedule that it is the share of, where it is of one alone."""

    @property
    def key(self) -> str:
        """What files call it: no two columns have the same, whatever a recipe calls its lights."""
        return f"success_1dof_light_{self.light}" if self.light else self.name


def columns(rows: Sequence[Row]) -> tuple[Column, ...]:
    """The columns of these rows that people read, in order: one for each light schedule among them."""
    known = (c for c in numbers(rows) if not c.rare or any(c.value(row) is not None for row in rows))
    return tuple(c for c in known if not c.hidden)


def numbers(rows: Sequence[Row]) -> tuple[Column, ...]:
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
            "level_with_best", "", "", str, "Whether the scenes cannot tell it from the best.", hidden=True
        ),
        *_ends("behind_best_low", "behind_best_high", "", "", percent, lead, hidden=True),
    )


def _success(lights: Sequence[str]) -> tuple[Column, ...]:
    group, names = "success", ("success_1dof_low", "success_1dof_high")
    half = f"Share within ½ depth of focus: blur ≤ 1 px. {ABSTAINED} above ≤1 DoF."
    one = "Share within 1 DoF, blur ≤ 2 px: this ranks."
    two = f"Share within 2 DoF, blur ≤ 4 px. {ABSTAINED} below ≤1 DoF."
    interval = "95 % interval of the share within 1 DoF, from a bootstrap over scenes."
    return (
        _column("success_half_dof", "≤½ DoF", group, percent, half, room=WIDE, share=True),
        _column("success_1dof", "≤1 DoF", group, percent, one, share=True),
        *_ends(*names, "≤1 DoF 95 %", group, percent, interval),
        _column("success_2dof", "≤2 DoF", group, percent, two, room=WIDE, share=True),
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
        *_ends(*names, "err DoF 95 %", group, two, interval, room=WIDE),
        _column("median_error_travel", "err travel", group, four, travel, room=WIDE),
        _column("median_error_frames", "err frames", group, _fixed(0), frames, room=WIDE, rare=True),
        _column("median_blur_px", "blur px", group, _fixed(1), blur, room=WIDE),
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
        _column("frames_seen", "seen", group, percent, seen, room=WIDE),
        _column("lens_travel", "lens", group, two, way),
        _column("reversals", "turns", group, _fixed(1), turns, rare=True),
        _column("time_to_focus_s", "to focus s", group, three, until, rare=True),
        _column("windows", "scores", group, _fixed(0), asked, room=WIDE),
        _column("seconds", "s", group, three, compute, room=WIDE),
    )


def percent(share: float) -> str:
    """A share as whole per cent."""
    return f"{share + TIE:.0%}"  # 0.375 is 38 %, whatever its last bit


def _column(
    name: str, header: str, group: str, show: Callable[[Any], str], meaning: str, **more: Any
) -> Column:
    """A column of the row's attribute ``name``."""
    value = attrgetter(name)

    def text(row: Row) -> str:
        held = value(row)
        return "–" if held is None else show(held)

    return Column(name, header, meaning, value, text, group=group, **more)


def _ends(
    low: str, high: str, header: str, group: str, show: Callable[[Any], str], meaning: str, **more: Any
) -> tuple[Column, Column]:
    """Both ends of an interval: the column of the first shows them, that of the second is for programs."""

    def text(row: Row) -> str:
        ends = getattr(row, low), getattr(row, high)
        return "–" if None in ends else "–".join(map(show, ends))

    more = {"room": USUAL, "rare": True, **more}
    first = Column(low, header, meaning, attrgetter(low), text, group=group, **more)
    return first, _column(high, "", group, show, "Its upper end.", hidden=True)


def _light(light: str, group: str) -> Column:
    def value(row: Row) -> float | None:
        return dict(row.success_by_light).get(light)

    def text(row: Row) -> str:
        share = value(row)
        return "–" if share is None else percent(share)

    meaning = f"Share within 1 DoF under the light {light}."
    return Column(f"success_1dof_{light}", light, meaning, value, text, group=group, share=True, light=light)


def _rank(row: Row) -> str:
    if row.rank is None:
        return "–"
    level = "~" if row.level_with_best and row.rank > 1 else ""
    return f"{row.rank}{'=' if row.tied else ''}{level}"


def _count(number: int) -> str:
    return str(number) if number else "–"


def _fixed(digits: int) -> Callable[[float], str]:
    return lambda number: f"{number:.{digits}f}"
