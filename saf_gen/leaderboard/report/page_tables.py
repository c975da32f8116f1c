"""The tables of the page as data: column headings and cells, from which the templates make HTML."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

from saf_gen.benchmark.curve_quality import AssessedCurve
from saf_gen.benchmark.records import RECORDS_FILE, Record
from saf_gen.leaderboard import (
    AGREEMENT_MEANINGS,
    AxisTable,
    Column,
    LeaderboardRow,
    NeighbourComparison,
    RankAgreement,
    list_shown_leaderboard_columns,
    rank_measures_by_curves,
)
from saf_gen.leaderboard.columns import ESSENTIAL, USUAL
from saf_gen.leaderboard.curve_tables import QUALITY_MEANINGS
from saf_gen.leaderboard.grain_tables import tabulate_leaderboard_grain
from saf_gen.leaderboard.report.page_answers import HeldAnswers
from saf_gen.leaderboard.table_formats import (
    AGREEMENT_HEADERS,
    NEIGHBOUR_HEADERS,
    format_leaderboard_bin,
    format_leaderboard_count,
    format_rank_agreement,
    format_ranked_neighbours,
)

MAX_GRAIN_ROWS = 100
_AGREEMENT_TITLES = [text for key, text in AGREEMENT_MEANINGS.items() if key not in ("shared", "high")]
MAX_LIGHT_CHARACTERS = 60
"""Largest total length of the names of light schedules at which their columns are shown at first.

The tables by condition and the view of all columns always show them.
"""


@dataclass(frozen=True)
class PageColumn:
    """A column heading.

    Attributes
    ----------
    header, title : str
        Text and tooltip.
    kind : str
        CSS class of the cells below. Columns of the classes ``name``, ``note`` and ``text`` are sorted as text, all
        others as numbers.
    shown_on : str
        Screens that show the column before the reader asks for all columns: ``any``, ``wide`` or ``none``.
    """

    header: str
    title: str = ""
    kind: str = ""
    shown_on: str = "any"


@dataclass(frozen=True)
class PageCell:
    """A cell: its text, a fraction (0 to 1) that is drawn as a bar behind it with its interval, and a link."""

    text: str
    fraction: float | None = None
    interval: tuple[float, float] | None = None
    link: str = ""


@dataclass(frozen=True)
class PageRow:
    """The cells of a row, and its CSS class."""

    cells: Sequence[PageCell]
    kind: str = ""


@dataclass(frozen=True)
class PageTable:
    """A sortable table.

    Attributes
    ----------
    caption : str
        Caption of the table.
    columns : sequence of PageColumn
        Column headings.
    bodies : sequence of sequence of PageRow
        Alternative contents, of which the page shows one at a time.
    groups : sequence of (str, int)
        Headings above the column headings, each with the number of columns that it spans.
    id : str
        Id in the page, if any.
    """

    caption: str
    columns: Sequence[PageColumn]
    bodies: Sequence[Sequence[PageRow]]
    groups: Sequence[tuple[str, int]] = ()
    id: str = ""


def tabulate_leaderboard(ranked: Sequence[Sequence[LeaderboardRow]]) -> PageTable:
    """Return the leaderboard with every column that tables show to readers.

    ``ranked`` holds the rows for all sequences, which determine the columns, followed by the rows of each selection.
    """
    shown = list_shown_leaderboard_columns(ranked[0])
    kinds = {"method": "name", "success_1dof": "main"}
    shown_on_by_key = _find_shown_on(shown)
    return PageTable(
        "Leaderboard",
        [PageColumn(c.header, c.meaning, kinds.get(c.key, ""), shown_on_by_key[c.key]) for c in shown],
        [[_leaderboard_row(row, shown) for row in rows] for rows in ranked],
        groups=[(group, len(list(columns))) for group, columns in groupby(shown, key=lambda c: c.group)],
        id="board",
    )


def tabulate_axis_for_report(table: AxisTable) -> PageTable:
    """Return the table of success within 1 DoF and median error in DoF, by method and bin of one axis."""
    counts = zip(table.bins, table.scenes, table.sequences, strict=True)
    return PageTable(
        f"{table.axis.title}: success within 1 DoF, median error in DoF",
        [
            PageColumn("method", kind="name"),
            *(
                PageColumn(b, f"{format_leaderboard_count(n, 'scene')}, {format_leaderboard_count(m, 'sequence')}")
                for b, n, m in counts
            ),
        ],
        [
            [
                PageRow([PageCell(method), *(PageCell(format_leaderboard_bin(b), b.success_1dof) for b in bins)])
                for method, bins in table.cells.items()
            ]
        ],
    )


def tabulate_ranked_neighbours(neighbours: Sequence[NeighbourComparison]) -> PageTable | None:
    """Return the table that compares each method with the next in rank; None for a single method."""
    if not neighbours:
        return None
    return PageTable(
        "Neighbours in rank",
        [PageColumn(header, kind="name" if n < 2 else "") for n, header in enumerate(NEIGHBOUR_HEADERS)],
        [[PageRow([PageCell(text) for text in format_ranked_neighbours(pair)]) for pair in neighbours]],
    )


def tabulate_rank_agreement(found: Sequence[RankAgreement]) -> PageTable | None:
    """Return the table of the agreement of rankings under two bins of a condition; None if no bins are compared."""
    if not found:
        return None
    texts = (0, 1, 2, len(AGREEMENT_HEADERS) - 1)
    titles = dict(zip(AGREEMENT_HEADERS, _AGREEMENT_TITLES, strict=True))
    return PageTable(
        "Agreement of ranks under two conditions",
        [PageColumn(h, titles[h], "text" if n in texts else "") for n, h in enumerate(AGREEMENT_HEADERS)],
        [[PageRow([PageCell(text) for text in format_rank_agreement(one)]) for one in found]],
    )


def tabulate_measures_for_report(curves: Sequence[AssessedCurve]) -> PageTable | None:
    """Return the table of the quality of each measure's focus curves; None if there are no curves."""
    rows = rank_measures_by_curves(curves)
    if not rows:
        return None
    counted = "Curves of known quality; in brackets, those constant or too short, or whose lens turned back or rested."
    return PageTable(
        "Focus curves of each measure: medians over sequences",
        [
            PageColumn("measure", kind="name"),
            PageColumn("curves", counted),
            *(PageColumn(name.replace("_", " "), meaning) for name, meaning in QUALITY_MEANINGS.items()),
        ],
        [
            [
                PageRow(
                    [
                        PageCell(row.measure),
                        PageCell(
                            f"{row.curves - row.without_quality}"
                            + (f" ({row.without_quality})" if row.without_quality else "")
                        ),
                        *(PageCell("–" if v is None else f"{v:.3g}") for v in row.medians.values()),
                    ]
                )
                for row in rows
            ]
        ],
    )


def tabulate_grain_for_report(records: Sequence[Record]) -> PageTable | None:
    """Return the table of the grain of each scene, at rest and moving; None if no recording states it.

    If there are more than MAX_GRAIN_ROWS rows, those with the most grain are kept.
    """
    tables = tabulate_leaderboard_grain(records)
    if not tables:
        return None
    if len(tables) > MAX_GRAIN_ROWS:
        tables = sorted(tables, key=lambda table: -table.rms[1] if table.rms else 1)[:MAX_GRAIN_ROWS]
    measures = list(dict.fromkeys(measure for table in tables for measure in table.of_curve))
    return PageTable(
        "Grain of the pictures",
        [
            PageColumn("scene", kind="name"),
            PageColumn("motion", kind="text"),
            PageColumn("sequences", "Sequences that state their grain, out of all sequences."),
            PageColumn("rms", "Rms of the noise divided by the mean, at best focus: median over sequences."),
            PageColumn("worst", "Rms of the noise divided by the mean, at best focus: largest value of any sequence."),
            *(
                PageColumn(measure, "Largest energy of the noise divided by the range of the curve.")
                for measure in measures
            ),
        ],
        [
            [
                PageRow(
                    [
                        PageCell(table.scene),
                        PageCell(table.scene_motion or "–"),
                        PageCell(f"{table.sequences[1]} of {table.sequences[0]}"),
                        *(PageCell(f"{x:.2%}") for x in table.rms or ()),
                        *(PageCell("unknown") for _ in range(0 if table.rms else 2)),
                        *(PageCell(f"{table.of_curve[m]:.3g}" if m in table.of_curve else "–") for m in measures),
                    ]
                )
                for table in tables
            ]
        ],
    )


def tabulate_names_for_report(values: Mapping[str, str], *, name: str, value: str) -> PageTable:
    """Return a table of names and a text for each; ``name`` and ``value`` are the headings."""
    return PageTable(
        f"{value} of each {name}",
        [PageColumn(name, kind="name"), PageColumn(value, kind="name")],
        [[PageRow([PageCell(key), PageCell(text)]) for key, text in values.items()]],
    )


def list_answers_for_report(held: HeldAnswers) -> list[list[str]]:
    """Return the texts of each answer's row, the worst first; answers without an error count as the worst."""
    return [
        [
            record.method,
            record.sequence,
            record.status,
            _format_number(record.position, 4),
            _format_number(record.truth, 4),
            _format_number(record.error_dof, 2),
            _format_number(record.blur_px, 1),
            str(line),
            record.note,
        ]
        for line, record in held.lines
    ]


def tabulate_answers_for_report(answers: Sequence[Sequence[str]]) -> PageTable:
    """Return the table of rows of list_answers_for_report; line numbers link to the file of records."""
    columns = [
        PageColumn("method", kind="name"),
        PageColumn("sequence", kind="name"),
        PageColumn("status", kind="text"),
        PageColumn("answer"),
        PageColumn("truth"),
        PageColumn("error, DoF"),
        PageColumn("blur px"),
        PageColumn("line", f"The line of the answer in {RECORDS_FILE}."),
        PageColumn("note", kind="note"),
    ]
    links = [RECORDS_FILE if column.header == "line" else "" for column in columns]
    rows = [
        PageRow([PageCell(text, link=link) for text, link in zip(answer, links, strict=True)]) for answer in answers
    ]
    return PageTable("Single answers", columns, [rows])


def _find_shown_on(columns: Sequence[Column]) -> dict[str, str]:
    """Return the screens that show each column at first, by key; columns of lights with long names are hidden."""
    characters = sum(len(column.header) + 3 for column in columns if column.light)
    shown_on_by_key = {}
    for column in columns:
        is_main = column.detail <= USUAL and not (column.light and characters > MAX_LIGHT_CHARACTERS)
        shown_on_by_key[column.key] = "any" if column.detail == ESSENTIAL else "wide" if is_main else "none"
    return shown_on_by_key


def _leaderboard_row(row: LeaderboardRow, shown: Sequence[Column]) -> PageRow:
    kind = "first" if row.rank == 1 else "level" if row.level_with_best else ""
    return PageRow([_leaderboard_cell(row, column) for column in shown], kind)


def _leaderboard_cell(row: LeaderboardRow, column: Column) -> PageCell:
    text = column.format_value(row)
    if column.key == "method":
        return PageCell(text, link="#answers")
    interval, low, high = None, row.success_1dof_low, row.success_1dof_high
    if column.key == "success_1dof" and low is not None and high is not None:
        interval = low, high
    return PageCell(text, column.value(row) if column.is_fraction else None, interval)


def _format_number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"
