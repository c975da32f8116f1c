"""Output of a leaderboard to files: JSON and CSV for programs, Markdown and LaTeX for readers."""

import json
from collections.abc import Sequence
from dataclasses import asdict, astuple, fields
from pathlib import Path
from typing import Any

from saf_gen import __version__
from saf_gen.benchmark.records import RECORDS_FILE, Record, write_records
from saf_gen.benchmark.results import SequenceFailure
from saf_gen.core.files import write_text
from saf_gen.core.plain_text import escape_markdown
from saf_gen.leaderboard.axes import AxisTable, BinSummary, keep_leaderboard_bins
from saf_gen.leaderboard.columns import list_leaderboard_columns, list_shown_leaderboard_columns
from saf_gen.leaderboard.csv_output import format_leaderboard_csv
from saf_gen.leaderboard.grain_tables import tabulate_leaderboard_grain
from saf_gen.leaderboard.leaderboard_tables import LeaderboardTables, compute_leaderboard_tables
from saf_gen.leaderboard.method_comparison import NeighbourComparison, Profile
from saf_gen.leaderboard.rank_agreement import AGREEMENT_MEANINGS, RankAgreement
from saf_gen.leaderboard.rows import LeaderboardRow
from saf_gen.leaderboard.scene_intervals import CONFIDENCE
from saf_gen.leaderboard.table_formats import (
    AGREEMENT_NOTE,
    compose_leaderboard_notes,
    explain_leaderboard_columns,
    format_leaderboard_axis,
    format_leaderboard_latex,
    format_leaderboard_markdown,
    format_leaderboard_profiles_markdown,
    format_rank_agreement_markdown,
    format_ranked_neighbours_markdown,
)


def write_leaderboard(
    folder: str | Path,
    *,
    rows: Sequence[LeaderboardRow],
    records: Sequence[Record],
    failures: Sequence[SequenceFailure] = (),
    tables: LeaderboardTables | None = None,
) -> list[Path]:
    """Write the tables of a leaderboard and records.jsonl into a folder.

    Each file is replaced atomically, so that no program can read a half-written file. None becomes null in JSON and an
    empty field in CSV.

    Parameters
    ----------
    folder : str or Path
        Folder to write to.
    rows : sequence of LeaderboardRow
        Rows of the leaderboard, best first.
    records : sequence of Record
        Records from which the rows were computed.
    failures : sequence of SequenceFailure, optional
        Sequences that could not be read.
    tables : LeaderboardTables, optional
        Tables of ``rows`` and ``records``, if they have been computed already.

    Returns
    -------
    list of Path
        Paths of the files.

    Raises
    ------
    BadInput
        If a file cannot be written.
    """
    tables = tables or compute_leaderboard_tables(rows, records)
    columns = list_leaderboard_columns(rows)
    texts = {
        "leaderboard.json": _format_json(rows, records=records, failures=failures, tables=tables),
        "leaderboard.csv": format_leaderboard_csv(
            [c.key for c in columns], [[c.value(row) for c in columns] for row in rows]
        ),
        "leaderboard.md": _format_page(rows, records=records, failures=failures, tables=tables),
        "leaderboard.tex": format_leaderboard_latex(rows),
        "axes.csv": _format_axes(tables.axes),
        "agreement.csv": _format_agreement(tables.agreement),
        "profiles.csv": _format_profiles(tables.comparison.profiles),
        "neighbours.csv": format_leaderboard_csv(
            [f.name for f in fields(NeighbourComparison)], map(astuple, tables.comparison.neighbours)
        ),
    }
    for name, text in texts.items():
        write_text(Path(folder) / name, text)
    write_records(Path(folder) / RECORDS_FILE, records)
    return [Path(folder) / name for name in (*texts, RECORDS_FILE)]


def _format_json(
    rows: Sequence[LeaderboardRow],
    *,
    records: Sequence[Record],
    failures: Sequence[SequenceFailure],
    tables: LeaderboardTables,
) -> str:
    columns = list_leaderboard_columns(rows)
    document = {
        "format": "saf-gen leaderboard",
        "version": __version__,
        "benchmark": sorted({r.benchmark or "" for r in records}),
        "ranked_by": "success_1dof",
        "track": sorted({r.track for r in records}),
        "rig": sorted({r.rig for r in records}),
        "columns": {c.key: c.meaning for c in columns},
        "rows": [{**{c.key: c.value(row) for c in columns}, "tied": list(row.tied)} for row in rows],
        "intervals": {
            "unit": "scene",
            "confidence": CONFIDENCE,
            "simultaneous": {"ranks": "all rivals of a row", "others": "each interval alone"},
            "unknown": next((row.missing_reason for row in rows if row.missing_reason), None),
        },
        "axes": [_axis_to_json(table) for table in tables.axes],
        "profiles": [asdict(one) for one in tables.comparison.profiles],
        "neighbours": [asdict(one) for one in tables.comparison.neighbours],
        "rank_agreement": [asdict(one) for one in tables.agreement],
        "notes": compose_leaderboard_notes(rows, records),
        "grain": [asdict(grain) for grain in tabulate_leaderboard_grain(records)],
        "data": {r.sequence: r.data for r in records},
        "code": {r.method: r.code for r in records},
        "tuning": {r.method: r.tuning for r in records if r.tuning},
        "parameters": {r.method: r.parameters for r in records},
        "machines": sorted({r.machine for r in records}),
        "failures": [{"sequence": f.sequence, "problem": f.problem} for f in failures],
    }
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _axis_to_json(table: AxisTable) -> dict[str, Any]:
    return {
        "axis": table.axis.name,
        "meaning": table.axis.meaning,
        "bins": [
            {"bin": name, "scenes": scenes, "sequences": sequences}
            for name, scenes, sequences in zip(table.bins, table.scenes, table.sequences, strict=True)
        ],
        "methods": {method: [asdict(cell) for cell in cells] for method, cells in table.cells.items()},
    }


def _format_axes(axes: Sequence[AxisTable]) -> str:
    header = ["axis", "bin", "scenes", "sequences", "method", *(f.name for f in fields(BinSummary))]
    lines = [
        [table.axis.name, *counts, method, *astuple(cell)]
        for table in axes
        for method, cells in table.cells.items()
        for *counts, cell in zip(table.bins, table.scenes, table.sequences, cells, strict=True)
    ]
    return format_leaderboard_csv(header, lines)


def _format_profiles(profiles: Sequence[Profile]) -> str:
    lines = []
    for one in profiles:
        unknown = [None] * len(one.limits)
        for values in zip(one.limits, one.fractions, one.low or unknown, one.high or unknown, strict=True):
            lines.append([one.quantity, one.method, *values])
    return format_leaderboard_csv(["quantity", "method", "limit", "fraction", "low", "high"], lines)


def _format_agreement(agreement: Sequence[RankAgreement]) -> str:
    *header, _ = AGREEMENT_MEANINGS
    lines = [[*astuple(one)[:-1], *one.most_moved] for one in agreement]
    return format_leaderboard_csv([*header, "most_moved", "rank_under_first", "rank_under_second"], lines)


def _format_page(
    rows: Sequence[LeaderboardRow],
    *,
    records: Sequence[Record],
    failures: Sequence[SequenceFailure],
    tables: LeaderboardTables,
) -> str:
    parts = [
        "# Leaderboard\n",
        format_leaderboard_markdown(rows),
        escape_markdown(" ".join(compose_leaderboard_notes(rows, records))) + "\n",
        explain_leaderboard_columns(list_shown_leaderboard_columns(rows)),
    ]
    if failures:
        parts.append(
            "Not read:\n\n" + "".join(f"- {escape_markdown(f'{f.sequence}: {f.problem}')}\n" for f in failures)
        )
    comparison = tables.comparison
    if comparison.neighbours:
        parts.append(f"## Neighbours in rank\n\n{format_ranked_neighbours_markdown(comparison.neighbours)}")
        for quantity, heading in (("error_dof", "Within depths of focus"), ("time_s", "In focus within seconds")):
            if group := [profile for profile in comparison.profiles if profile.quantity == quantity]:
                parts.append(f"## {heading}\n\n{format_leaderboard_profiles_markdown(group)}")
    parts += [
        f"## {table.axis.title}\n\n{table.axis.meaning} Success within 1 DoF (median error in DoF).\n\n"
        + format_leaderboard_axis(table)
        for table in map(keep_leaderboard_bins, tables.axes)
        if len(table.bins) > 1
    ]
    if tables.agreement:
        agreement = format_rank_agreement_markdown(tables.agreement)
        parts.append(f"## Agreement of ranks\n\n{AGREEMENT_NOTE}\n\n{agreement}")
    return "\n".join(parts)
