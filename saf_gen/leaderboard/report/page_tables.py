"""The tables of the page as data: column headings and cells, which the templates turn into HTML."""

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
    count_noun_in_leaderboard,
    format_leaderboard_bin,
    format_rank_agreement,
    format_ranked_neighbours,
)

MAX_GRAIN_ROWS = 100
_AGREEMENT_TITLES = [text for key, text in AGREEMENT_MEANINGS.items() if key not in ("shared", "high")]
MAX_LIGHT_CHARACTERS = 60
"""Longest names of light schedules, together, whose columns are shown at first; the tables by condition have all."""


@dataclass(frozen=True)
class PageColumn:
    """A column heading: its text, the tooltip, and a CSS class for the cells below it.

    The classes ``name``, ``note`` and ``text`` mark columns that sort as text; any other sorts as numbers. ``room``
    says where the column is shown before all columns are asked for: ``any`` screen, a ``wide`` one, or ``none``.
    """

    header: str
    title: str = ""
    kind: str = ""
    room: str = "any"


@dataclass(frozen=True)
class PageCell:
    """A cell: its text, a fraction (0–1) drawn as a bar behind it, the interval of the fraction, and a link."""

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
    """A sortable table; of several ``bodies`` the page shows one at a time.

    ``groups`` stand above the headings, each with the number of columns that it spans.
    """

    caption: str
    columns: Sequence[PageColumn]
    bodies: Sequence[Sequence[PageRow]]
    groups: Sequence[tuple[str, int]] = ()
    id: str = ""


def tabulate_leaderboard(ranked: Sequence[Sequence[LeaderboardRow]]) -> PageTable:
    """Return the leaderboard with every column that people read.

    ``ranked`` holds the rows for all sequences, which decide the columns, and then those of each selection.
    """
    shown = list_shown_leaderboard_columns(ranked[0])
    kinds = {"method": "name", "success_1dof": "main"}
    rooms = _find_room(shown)
    return PageTable(
        "Leaderboard",
        [PageColumn(c.header, c.meaning, kinds.get(c.key, ""), rooms[c.key]) for c in shown],
        [[_leaderboard_row(row, shown) for row in rows] for rows in ranked],
        groups=[(group, len(list(columns))) for group, columns in groupby(shown, key=lambda c: c.group)],
        id="board",
    )


def tabulate_axis_for_report(table: AxisTable) -> PageTable:
    """Return the methods by the bins of one axis: success within 1 DoF and the median error in DoF."""
    counts = zip(table.bins, table.scenes, table.sequences, strict=True)
    return PageTable(
        f"{table.axis.title}: success within 1 DoF, median error in DoF",
        [
            PageColumn("method", kind="name"),
            *(
                PageColumn(b, f"{count_noun_in_leaderboard(n, 'scene')}, {count_noun_in_leaderboard(m, 'sequence')}")
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
    """Return the comparison of each method with the next in rank; None for a single method."""
    if not neighbours:
        return None
    return PageTable(
        "Neighbours in rank",
        [PageColumn(header, kind="name" if n < 2 else "") for n, header in enumerate(NEIGHBOUR_HEADERS)],
        [[PageRow([PageCell(text) for text in format_ranked_neighbours(pair)]) for pair in neighbours]],
    )


def tabulate_rank_agreement(found: Sequence[RankAgreement]) -> PageTable | None:
    """Return how the rankings under two bins of a condition agree; None where nothing can be compared."""
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
    """Return the quality of each measure's focus curves; None where there is no curve."""
    rows = rank_measures_by_curves(curves)
    if not rows:
        return None
    counted = "Sequences with a curve; in brackets those whose lens comes back, rests, or is not recorded."
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
    """Return the grain of each scene, at rest and moving, of many the worst; None where no recording states it."""
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
            PageColumn("sequences", "Sequences that state their grain, of all."),
            PageColumn("rms", "Root mean square of the noise over the mean at best focus: median over sequences."),
            PageColumn("worst", "The largest of them."),
            *(PageColumn(measure, "Largest energy of the noise over the range of the curve.") for measure in measures),
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
    """Return a table of names with a text for each; ``name`` and ``value`` are its headings."""
    return PageTable(
        f"{value} of each {name}",
        [PageColumn(name, kind="name"), PageColumn(value, kind="name")],
        [[PageRow([PageCell(key), PageCell(text)]) for key, text in values.items()]],
    )


def list_answers_for_report(held: HeldAnswers) -> list[list[str]]:
    """Return the texts of each answer's row, the worst first: no answer before any error."""
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
    """Return the table of these rows of list_answers_for_report; the line number links to the file of records."""
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


def _find_room(columns: Sequence[Column]) -> dict[str, str]:
    """Return where each column is shown at first: lights only as far as their names fit beside the others."""
    characters = sum(len(column.header) + 3 for column in columns if column.light)
    rooms = {}
    for column in columns:
        is_main = column.detail <= USUAL and not (column.light and characters > MAX_LIGHT_CHARACTERS)
        rooms[column.key] = "any" if column.detail == ESSENTIAL else "wide" if is_main else "none"
    return rooms


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
