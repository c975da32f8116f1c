"""The files of a leaderboard."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from saf_gen import __version__
from saf_gen.dataset import write_text
from saf_gen.evaluate import Failure
from saf_gen.leaderboard.axes import AxisTable, by_axis
from saf_gen.leaderboard.columns import columns, numbers
from saf_gen.leaderboard.csv_text import csv_text
from saf_gen.leaderboard.rows import Row
from saf_gen.leaderboard.texts import axis_markdown, latex, legend, markdown, notes
from saf_gen.records import FILE, Record, records_to_text
from saf_gen.statistics import CONFIDENCE, RESAMPLES

__all__ = ["write_files"]


def write_files(
    folder: str | Path,
    *,
    rows: Sequence[Row],
    records: Sequence[Record],
    failures: Sequence[Failure] = (),
) -> list[Path]:
    """Write leaderboard.json, .csv, .md and .tex, axes.csv and records.jsonl into ``folder``; returns paths.

    Each file is replaced at once, never seen half written; BadInput where that fails. None becomes null, or
    an empty field of a csv.
    """
    out = Path(folder)
    axes = by_axis(records, [row.method for row in rows])
    shown = numbers(rows)
    sheet = [[c.value(row) for c in shown] for row in rows]
    texts = {
        "leaderboard.json": _document(rows, records, failures, axes),
        "leaderboard.csv": csv_text([c.key for c in shown], sheet),
        "leaderboard.md": _page(rows, records, failures, axes),
        "leaderboard.tex": latex(rows),
        "axes.csv": _axes_csv(axes),
        FILE: records_to_text(records),
    }
    for name, text in texts.items():
        write_text(out / name, text)
    return [out / name for name in texts]


def _document(
    rows: Sequence[Row], records: Sequence[Record], failures: Sequence[Failure], axes: Sequence[AxisTable]
) -> str:
    shown = numbers(rows)
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
            "unknown": next((row.why for row in rows if row.why), None),
        },
        "axes": [_axis(table) for table in axes],
        "notes": notes(rows, records),
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
    return csv_text([*heads, "success_1dof", "median_error_dof", "abstained", "failed"], lines)


def _page(
    rows: Sequence[Row], records: Sequence[Record], failures: Sequence[Failure], axes: Sequence[AxisTable]
) -> str:
    parts = ["# Leaderboard\n", markdown(rows), " ".join(notes(rows, records)) + "\n", legend(columns(rows))]
    if failures:
        parts.append("Not read:\n\n" + "".join(f"- `{f.sequence}`: {f.problem}\n" for f in failures))
    for table in axes:
        if len(table.bins) > 1:
            parts.append(
                f"## {table.axis.title}\n\n{table.axis.meaning} Share within 1 DoF (median error in DoF).\n\n"
                + axis_markdown(table)
            )
    return "\n".join(parts)
