"""The tables of the page: the leaderboard, methods by condition, measures by their curves, digests."""

from collections.abc import Mapping, Sequence
from itertools import groupby

from saf_gen.contest.results import Sweep
from saf_gen.leaderboard import AxisTable, Column, Row, columns, curve_rows, measure_rows
from saf_gen.leaderboard.columns import percent
from saf_gen.leaderboard.curves import MEANINGS
from saf_gen.report._html import Cell, Head, escaped, grid

__all__ = ["axis_tables", "board", "digests", "lead", "meanings", "measures"]


def lead(rows: Sequence[Row]) -> str:
    """The result in a sentence."""
    first = [row for row in rows if row.rank == 1]
    if not first:
        return "No sequence has a known truth, so nothing is ranked: the table shows cost only."
    names = ", ".join(f"<code>{escaped(row.method)}</code>" for row in first[:4])
    if len(first) > 4:
        names += f" and {len(first) - 4} more"
    verb = "lead together" if len(first) > 1 else "leads"
    share = percent(first[0].success_1dof or 0.0)  # a rank has one
    return f"{names} {verb}: within one depth of focus on {share} of the scenes and lights."


def board(rows: Sequence[Row]) -> str:
    """The leaderboard: every column that people read."""
    shown = columns(rows)
    groups = [(group, len(list(some))) for group, some in groupby(shown, key=lambda c: c.group)]
    heads = [Head(c.header, c.meaning, c.justify == "left", c.key) for c in shown]
    cells = [[_cell(row, column) for column in shown] for row in rows]
    kinds = ["first" if row.rank == 1 else "level" if row.level_with_best else "" for row in rows]
    return grid(heads, cells, caption="Leaderboard", groups=groups, id_="board", kinds=kinds)


def axis_tables(tables: Sequence[AxisTable]) -> str:
    """A table for each axis along which the sequences differ: share within 1 DoF, median error in DoF."""
    parts = []
    for table in tables:
        if len(table.bins) < 2:
            continue
        heads = [Head("method", left=True)]
        for name, scenes, sequences in zip(table.bins, table.scenes, table.sequences, strict=True):
            heads.append(Head(name, f"{_many(scenes, 'scene')}, {_many(sequences, 'sequence')}"))
        rows = [
            [
                Cell(method, kind="method"),
                *(
                    Cell(
                        "–"
                        if cell.success_1dof is None
                        else percent(cell.success_1dof) + _error(cell.median_error_dof),
                        cell.success_1dof,
                        bar=cell.success_1dof,
                    )
                    for cell in cells
                ),
            ]
            for method, cells in table.cells.items()
        ]
        parts.append(
            f"<section><h3>{escaped(table.axis.title)}</h3><p class='soft'>{escaped(table.axis.meaning)}</p>"
            + grid(heads, rows, caption=f"{table.axis.title}: share within 1 DoF, median error in DoF")
            + "</section>"
        )
    return "\n".join(parts)


def measures(sweeps: Sequence[Sweep]) -> str:
    """How good the curve of each measure is, whatever searches it; '' where there is no curve."""
    rows = measure_rows(curve_rows(sweeps))
    if not rows:
        return ""
    heads = [
        Head("measure", left=True),
        Head(
            "curves", "Sequences with a curve; in brackets those whose lens comes back, rests, or sees none."
        ),
        *(Head(name.replace("_", " "), meaning) for name, meaning in MEANINGS.items()),
    ]
    cells = [
        [
            Cell(row.measure, kind="method"),
            Cell(f"{row.curves - row.without}" + (f" ({row.without})" if row.without else ""), row.curves),
            *(Cell("–" if v is None else f"{v:.3g}", v) for v in row.medians.values()),
        ]
        for row in rows
    ]
    return grid(heads, cells, caption="Focus curves of each measure: medians over sequences")


def meanings(shown: Sequence[Column]) -> str:
    """What the columns mean, as terms of a list."""
    names = [f"{c.group}, {c.header}" if c.group else c.header for c in shown]
    return "".join(
        f"<dt>{escaped(name)}</dt><dd>{escaped(c.meaning)}</dd>" for name, c in zip(names, shown, strict=True)
    )


def digests(held: Mapping[str, str], what: str, digest: str) -> str:
    """Names and digests as a table."""
    rows = [[Cell(name, kind="method"), Cell(text, kind="method")] for name, text in held.items()]
    return grid([Head(what, left=True), Head(digest, left=True)], rows, caption=f"{digest} of each {what}")


def _cell(row: Row, column: Column) -> Cell:
    value = column.value(row)
    number = float(value) if isinstance(value, bool | int | float) else None
    share = number if column.share else None
    ends = None
    if (
        column.name == "success_1dof"
        and row.success_1dof_low is not None
        and row.success_1dof_high is not None
    ):
        ends = row.success_1dof_low, row.success_1dof_high
    kind = "method" if column.name == "method" else "rank" if column.name == "success_1dof" else ""
    return Cell(column.text(row), number, kind, share, ends)


def _error(error: float | None) -> str:
    return "" if error is None else f" ({error:.2f})"


def _many(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
