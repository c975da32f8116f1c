"""The tables of the page: the leaderboard, methods by condition, measures by their curves, digests."""

from collections.abc import Mapping, Sequence
from itertools import groupby

from saf_gen.benchmark.results import SweepSummary
from saf_gen.leaderboard import (
    AxisTable,
    Column,
    LeaderboardRow,
    assess_curves,
    list_shown_columns,
    summarise_measures,
)
from saf_gen.leaderboard.columns import format_percent
from saf_gen.leaderboard.curve_tables import QUALITY_MEANINGS
from saf_gen.leaderboard.report._html import HeaderCell, TableCell, escape_html, format_table

__all__ = [
    "compose_headline",
    "format_axis_tables",
    "format_column_meanings",
    "format_digest_table",
    "format_leaderboard",
    "format_measure_table",
]


def compose_headline(rows: Sequence[LeaderboardRow]) -> str:
    """The result in a sentence."""
    first = [row for row in rows if row.rank == 1]
    if not first:
        return "No sequence has a known truth, so nothing is ranked: the table shows cost only."
    names = ", ".join(f"<code>{escape_html(row.method)}</code>" for row in first[:4])
    if len(first) > 4:
        names += f" and {len(first) - 4} more"
    verb = "lead together" if len(first) > 1 else "leads"
    share = format_percent(first[0].success_1dof or 0.0)  # a rank has one
    return f"{names} {verb}: within one depth of focus on {share} of the scenes and lights."


def format_leaderboard(rows: Sequence[LeaderboardRow]) -> str:
    """The leaderboard: every column that people read."""
    shown = list_shown_columns(rows)
    groups = [(group, len(list(some))) for group, some in groupby(shown, key=lambda c: c.group)]
    heads = [HeaderCell(c.header, c.meaning, c.justify == "left", c.key) for c in shown]
    cells = [[_cell(row, column) for column in shown] for row in rows]
    kinds = ["first" if row.rank == 1 else "level" if row.level_with_best else "" for row in rows]
    return format_table(heads, cells, caption="Leaderboard", groups=groups, id_="board", kinds=kinds)


def format_axis_tables(tables: Sequence[AxisTable]) -> str:
    """A table for each axis along which the sequences differ: share within 1 DoF, median error in DoF."""
    parts = []
    for table in tables:
        if len(table.bins) < 2:
            continue
        heads = [HeaderCell("method", left=True)]
        for name, scenes, sequences in zip(table.bins, table.scenes, table.sequences, strict=True):
            heads.append(HeaderCell(name, f"{_many(scenes, 'scene')}, {_many(sequences, 'sequence')}"))
        rows = [
            [
                TableCell(method, kind="method"),
                *(
                    TableCell(
                        "–"
                        if cell.success_1dof is None
                        else format_percent(cell.success_1dof) + _error(cell.median_error_dof),
                        cell.success_1dof,
                        bar=cell.success_1dof,
                    )
                    for cell in cells
                ),
            ]
            for method, cells in table.cells.items()
        ]
        parts.append(
            f"<section><h3>{escape_html(table.axis.title)}</h3>"
            f"<p class='soft'>{escape_html(table.axis.meaning)}</p>"
            + format_table(
                heads, rows, caption=f"{table.axis.title}: share within 1 DoF, median error in DoF"
            )
            + "</section>"
        )
    return "\n".join(parts)


def format_measure_table(sweeps: Sequence[SweepSummary]) -> str:
    """How good the curve of each measure is, whatever searches it; '' where there is no curve."""
    rows = summarise_measures(assess_curves(sweeps))
    if not rows:
        return ""
    heads = [
        HeaderCell("measure", left=True),
        HeaderCell(
            "curves", "Sequences with a curve; in brackets those whose lens comes back, rests, or sees none."
        ),
        *(HeaderCell(name.replace("_", " "), meaning) for name, meaning in QUALITY_MEANINGS.items()),
    ]
    cells = [
        [
            TableCell(row.measure, kind="method"),
            TableCell(
                f"{row.curves - row.without_quality}"
                + (f" ({row.without_quality})" if row.without_quality else ""),
                row.curves,
            ),
            *(TableCell("–" if v is None else f"{v:.3g}", v) for v in row.medians.values()),
        ]
        for row in rows
    ]
    return format_table(heads, cells, caption="Focus curves of each measure: medians over sequences")


def format_column_meanings(shown: Sequence[Column]) -> str:
    """What the columns mean, as terms of a list."""
    names = [f"{c.group}, {c.header}" if c.group else c.header for c in shown]
    return "".join(
        f"<dt>{escape_html(name)}</dt><dd>{escape_html(c.meaning)}</dd>"
        for name, c in zip(names, shown, strict=True)
    )


def format_digest_table(held: Mapping[str, str], what: str, digest: str) -> str:
    """Names and digests as a table."""
    rows = [[TableCell(name, kind="method"), TableCell(text, kind="method")] for name, text in held.items()]
    return format_table(
        [HeaderCell(what, left=True), HeaderCell(digest, left=True)], rows, caption=f"{digest} of each {what}"
    )


def _cell(row: LeaderboardRow, column: Column) -> TableCell:
    value = column.value(row)
    number = float(value) if isinstance(value, bool | int | float) else None
    share = number if column.is_fraction else None
    ends = None
    if (
        column.name == "success_1dof"
        and row.success_1dof_low is not None
        and row.success_1dof_high is not None
    ):
        ends = row.success_1dof_low, row.success_1dof_high
    kind = "method" if column.name == "method" else "rank" if column.name == "success_1dof" else ""
    return TableCell(column.format_value(row), number, kind, share, ends)


def _error(error: float | None) -> str:
    return "" if error is None else f" ({error:.2f})"


def _many(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
