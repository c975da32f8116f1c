"""The files of a leaderboard."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from saf_gen import __version__
from saf_gen.benchmark.records import RECORDS_FILE, Record, format_records
from saf_gen.benchmark.results import SequenceFailure
from saf_gen.leaderboard.axes import AxisTable, tabulate_by_axis
from saf_gen.leaderboard.columns import list_all_columns, list_shown_columns
from saf_gen.leaderboard.csv_output import format_csv
from saf_gen.leaderboard.rows import LeaderboardRow
from saf_gen.leaderboard.statistics import CONFIDENCE, RESAMPLES
from saf_gen.leaderboard.table_formats import (
    compose_notes,
    explain_columns,
    format_axis_markdown,
    format_latex,
    format_markdown,
)
from saf_gen.stream.manifest import write_text_atomically

__all__ = ["write_leaderboard"]


def write_leaderboard(
    folder: str | Path,
    *,
    rows: Sequence[LeaderboardRow],
    records: Sequence[Record],
    failures: Sequence[SequenceFailure] = (),
) -> list[Path]:
    """Write leaderboard.json, .csv, .md and .tex, axes.csv and records.jsonl into ``folder``; returns paths.

    Each file is replaced at once, never seen half written; BadInput where that fails. None becomes null, or
    an empty field of a csv.
    """
    out = Path(folder)
    axes = tabulate_by_axis(records, [row.method for row in rows])
    shown = list_all_columns(rows)
    sheet = [[c.value(row) for c in shown] for row in rows]
    texts = {
        "leaderboard.json": _document(rows, records, failures, axes),
        "leaderboard.csv": format_csv([c.key for c in shown], sheet),
        "leaderboard.md": _page(rows, records, failures, axes),
        "leaderboard.tex": format_latex(rows),
        "axes.csv": _axes_csv(axes),
        RECORDS_FILE: format_records(records),
    }
    for name, text in texts.items():
        write_text_atomically(out / name, text)
    return [out / name for name in texts]


def _document(
    rows: Sequence[LeaderboardRow],
    records: Sequence[Record],
    failures: Sequence[SequenceFailure],
    axes: Sequence[AxisTable],
) -> str:
    shown = list_all_columns(rows)
    document = {
        "format": "saf-gen leaderboard",
        "version": __version__,
        "ranked_by": "success_1dof",
        "track": sorted({r.track for r in records}),
        "rig": sorted({r.rig for r in records}),
        "columns": {c.key: c.meaning for c in shown},
        "rows": [{**{c.key: c.value(row) for c in shown}, "tied": list(row.tied)} for row in rows],
        "intervals": {
            "unit": "scene",
            "confidence": CONFIDENCE,
            "resamples": RESAMPLES,
            "unknown": next((row.missing_reason for row in rows if row.missing_reason), None),
        },
        "axes": [_axis(table) for table in axes],
        "notes": compose_notes(rows, records),
        "data": {r.sequence: r.data for r in records},
        "code": {r.method: r.code for r in records},
        "tuning": {r.method: r.tuning for r in records if r.tuning},
        "parameters": {r.method: r.parameters for r in records},
        "machines": sorted({r.machine for r in records}),
        "failures": [{"sequence": f.sequence, "problem": f.problem} for f in failures],
    }
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _axis(table: AxisTable) -> dict[str, Any]:
    return {
        "axis": table.axis.name,
        "meaning": table.axis.meaning,
        "bins": [
            {"bin": name, "scenes": scenes, "sequences": sequences}
            for name, scenes, sequences in zip(table.bins, table.scenes, table.sequences, strict=True)
        ],
        "methods": {method: [asdict(cell) for cell in cells] for method, cells in table.cells.items()},
    }


def _axes_csv(axes: Sequence[AxisTable]) -> str:
    heads = ["axis", "bin", "scenes", "sequences", "method"]
    lines = []
    for table in axes:
        for method, cells in table.cells.items():
            for name, scenes, sequences, cell in zip(
                table.bins, table.scenes, table.sequences, cells, strict=True
            ):
                lines.append([table.axis.name, name, scenes, sequences, method, *asdict(cell).values()])
    return format_csv([*heads, "success_1dof", "median_error_dof", "abstained", "failed"], lines)


def _page(
    rows: Sequence[LeaderboardRow],
    records: Sequence[Record],
    failures: Sequence[SequenceFailure],
    axes: Sequence[AxisTable],
) -> str:
    parts = [
        "# Leaderboard\n",
        format_markdown(rows),
        " ".join(compose_notes(rows, records)) + "\n",
        explain_columns(list_shown_columns(rows)),
    ]
    if failures:
        parts.append("Not read:\n\n" + "".join(f"- `{f.sequence}`: {f.problem}\n" for f in failures))
    for table in axes:
        if len(table.bins) > 1:
            parts.append(
                f"## {table.axis.title}\n\n{table.axis.meaning} Share within 1 DoF (median error in DoF).\n\n"
                + format_axis_markdown(table)
            )
    return "\n".join(parts)
