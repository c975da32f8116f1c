"""Writes the files of a leaderboard: JSON and CSV for programs, Markdown and LaTeX for people."""

import json
from collections.abc import Sequence
from dataclasses import asdict, astuple, fields
from pathlib import Path
from typing import Any

from saf_gen import __version__
from saf_gen.benchmark.records import RECORDS_FILE, Record, write_benchmark_records
from saf_gen.benchmark.results import SequenceFailure
from saf_gen.core.files import write_text_atomically
from saf_gen.core.plain_text import escape_markdown
from saf_gen.leaderboard.axes import AxisTable, BinSummary, keep_leaderboard_bins, tabulate_leaderboard_by_axis
from saf_gen.leaderboard.columns import list_leaderboard_columns, list_shown_leaderboard_columns
from saf_gen.leaderboard.csv_output import format_leaderboard_csv
from saf_gen.leaderboard.grain_tables import tabulate_leaderboard_grain
from saf_gen.leaderboard.method_comparison import MethodComparison, NeighbourComparison, Profile, compare_ranked_methods
from saf_gen.leaderboard.rank_agreement import AGREEMENT_MEANINGS, RankAgreement, compare_rankings
from saf_gen.leaderboard.rows import LeaderboardRow
from saf_gen.leaderboard.scene_intervals import CONFIDENCE
from saf_gen.leaderboard.table_formats import (
    AGREEMENT_NOTE,
    compose_leaderboard_notes,
    explain_leaderboard_columns,
    format_leaderboard_axis,
    format_leaderboard_latex,
    format_leaderboard_markdown,
    format_neighbour_markdown_of_leaderboard,
    format_profile_markdown_of_leaderboard,
    format_rank_agreement_markdown,
)


def write_leaderboard(
    folder: str | Path,
    *,
    rows: Sequence[LeaderboardRow],
    records: Sequence[Record],
    failures: Sequence[SequenceFailure] = (),
) -> list[Path]:
    """Write the leaderboard's tables and records.jsonl into ``folder``; return the paths.

    Each file is replaced at once, never seen half written. None becomes null, or an empty field of a CSV.
    Raises BadInput where a file cannot be written.
    """
    axes = tabulate_leaderboard_by_axis(records, [row.method for row in rows])
    agreement = compare_rankings(records)
    comparison = compare_ranked_methods(records, [row.method for row in rows])
    columns = list_leaderboard_columns(rows)
    texts = {
        "leaderboard.json": _format_json(
            rows, records=records, failures=failures, axes=axes, agreement=agreement, comparison=comparison
        ),
        "leaderboard.csv": format_leaderboard_csv(
            [c.key for c in columns], [[c.value(row) for c in columns] for row in rows]
        ),
        "leaderboard.md": _format_page(
            rows, records=records, failures=failures, axes=axes, agreement=agreement, comparison=comparison
        ),
        "leaderboard.tex": format_leaderboard_latex(rows),
        "axes.csv": _format_axes(axes),
        "agreement.csv": _format_agreement(agreement),
        "profiles.csv": _format_profiles(comparison.profiles),
        "neighbours.csv": format_leaderboard_csv(
            [f.name for f in fields(NeighbourComparison)], map(astuple, comparison.neighbours)
        ),
    }
    for name, text in texts.items():
        write_text_atomically(Path(folder) / name, text)
    write_benchmark_records(Path(folder) / RECORDS_FILE, records)
    return [Path(folder) / name for name in (*texts, RECORDS_FILE)]


def _format_json(
    rows: Sequence[LeaderboardRow],
    *,
    records: Sequence[Record],
    failures: Sequence[SequenceFailure],
    axes: Sequence[AxisTable],
    agreement: Sequence[RankAgreement],
    comparison: MethodComparison,
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
        "axes": [_axis_to_json(table) for table in axes],
        "profiles": [asdict(one) for one in comparison.profiles],
        "neighbours": [asdict(one) for one in comparison.neighbours],
        "rank_agreement": [asdict(one) for one in agreement],
        "notes": compose_leaderboard_notes(rows, records),
        "grain": [asdict(table) for table in tabulate_leaderboard_grain(records)],
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
    axes: Sequence[AxisTable],
    agreement: Sequence[RankAgreement],
    comparison: MethodComparison,
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
    if comparison.neighbours:
        parts.append(f"## Neighbours in rank\n\n{format_neighbour_markdown_of_leaderboard(comparison.neighbours)}")
        for quantity, heading in (("error_dof", "Within depths of focus"), ("time_s", "In focus within seconds")):
            if own := [profile for profile in comparison.profiles if profile.quantity == quantity]:
                parts.append(f"## {heading}\n\n{format_profile_markdown_of_leaderboard(own)}")
    parts += [
        f"## {table.axis.title}\n\n{table.axis.meaning} Success within 1 DoF (median error in DoF).\n\n"
        + format_leaderboard_axis(table)
        for table in map(keep_leaderboard_bins, axes)
        if len(table.bins) > 1
    ]
    if agreement:
        parts.append(f"## Agreement of ranks\n\n{AGREEMENT_NOTE}\n\n" + format_rank_agreement_markdown(agreement))
    return "\n".join(parts)
