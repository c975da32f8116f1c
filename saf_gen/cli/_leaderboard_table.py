"""Print a leaderboard in the terminal."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.table import Table

from saf_gen.cli._terminal import out

if TYPE_CHECKING:
    from saf_gen.benchmark.records import Record
    from saf_gen.leaderboard import LeaderboardRow
    from saf_gen.leaderboard.report import WrittenEvaluation


def print_leaderboard(rows: "Sequence[LeaderboardRow]", *, title: str, records: "Sequence[Record]" = ()) -> None:
    """Print the columns that fit the terminal, and the notes that ``records`` call for."""
    from saf_gen.leaderboard import compose_leaderboard_notes, list_shown_columns

    shown = [c for c in list_shown_columns(rows) if out.width >= c.min_terminal_width]
    if out.width < 75:
        shown = [c for c in shown if c.name in ("rank", "method", "success_1dof", "median_error_dof")]
    board = Table(title=title)
    for column in shown:
        board.add_column(column.header, justify=column.justify, no_wrap=column.name == "method")
    for row in rows:
        board.add_row(*(column.format_value(row) for column in shown))
    out.print(board)
    for note in compose_leaderboard_notes(rows, records) if records else ():
        out.print(note)


def print_written_paths(written: "WrittenEvaluation") -> None:
    """Print the paths of an evaluation's files, and which evaluation they replaced."""
    for path in written.paths:
        out.print(str(path), soft_wrap=True)
    if written.replaced:
        out.print(written.replaced, soft_wrap=True)
