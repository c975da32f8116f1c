"""A leaderboard in the terminal."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.table import Table

from saf_gen.cli._terminal import out

if TYPE_CHECKING:
    from saf_gen.leaderboard import Row
    from saf_gen.records import Record
    from saf_gen.report import Written

__all__ = ["show_board", "show_written"]


def show_board(rows: "Sequence[Row]", *, title: str, records: "Sequence[Record]" = ()) -> None:
    """Print the columns that there is room for; of ``records``, what must be known to read them."""
    from saf_gen.leaderboard import columns, notes

    shown = [c for c in columns(rows) if out.width >= c.room]
    if out.width < 75:
        shown = [c for c in shown if c.name in ("rank", "method", "success_1dof", "median_error_dof")]
    board = Table(title=title)
    for column in shown:
        board.add_column(column.header, justify=column.justify, no_wrap=column.name == "method")
    for row in rows:
        board.add_row(*(column.text(row) for column in shown))
    out.print(board)
    for note in notes(rows, records) if records else ():
        out.print(note)


def show_written(written: "Written") -> None:
    """Print the paths of an evaluation, and what they replaced."""
    for path in written.paths:
        out.print(str(path), soft_wrap=True)
    if written.replaced:
        out.print(written.replaced, soft_wrap=True)
