"""Leaderboards in the terminal."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from saf_gen.cli._tables import TableColumn, print_table
from saf_gen.cli._terminal import out

if TYPE_CHECKING:
    from saf_gen.benchmark.records import Record
    from saf_gen.leaderboard import LeaderboardRow
    from saf_gen.leaderboard.report import WrittenEvaluation


def print_leaderboard(rows: "Sequence[LeaderboardRow]", *, title: str, records: "Sequence[Record]" = ()) -> None:
    """Print the columns of a leaderboard that fit, and the notes that apply to ``records``."""
    from saf_gen.leaderboard import compose_leaderboard_notes, list_shown_leaderboard_columns

    shown = list_shown_leaderboard_columns(rows)
    print_table(
        [
            TableColumn(c.header, drop_order=c.detail, justify=c.justify, group=c.group if c.light else "")
            for c in shown
        ],
        [[column.format_value(row) for column in shown] for row in rows],
        title=title,
        where_to_find="leaderboard.md, the page and a pipe show them",
    )
    for note in compose_leaderboard_notes(rows, records) if records else ():
        out.print(note)


def print_written_paths(written: "WrittenEvaluation") -> None:
    """Print the paths of an evaluation's files, and the evaluation that they replaced, if any."""
    for path in written.paths:
        out.print(str(path), soft_wrap=True)
    if written.replaced:
        out.print(written.replaced, soft_wrap=True)
