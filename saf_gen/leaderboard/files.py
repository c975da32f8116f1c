"""Output of a leaderboard to files: JSON and CSV for programs, Markdown and LaTeX for readers."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from saf_gen import __version__
from saf_gen.benchmark.curve_quality import AssessedCurve
from saf_gen.benchmark.records import RECORDS_FILE, Record, write_records
from saf_gen.benchmark.results import SequenceFailure
from saf_gen.core.files import write_text
from saf_gen.core.plain_text import escape_markdown
from saf_gen.leaderboard import tables
from saf_gen.leaderboard.axes import AxisResults, by_axis, keep_largest
from saf_gen.leaderboard.intervals import CONFIDENCE
from saf_gen.leaderboard.method_comparison import MethodComparison, compare_methods
from saf_gen.leaderboard.notes import grain_by_scene, notes_on
from saf_gen.leaderboard.outcomes import RULE
from saf_gen.leaderboard.ranking import LeaderboardRow
from saf_gen.leaderboard.short_names import name_list

LEADERBOARD_FILES = (
    *("leaderboard.json", "leaderboard.csv", "leaderboard.md", "leaderboard.tex"),
    *("axes.csv", "profiles.csv", "neighbours.csv"),
)
"""Names of the tables of a leaderboard."""


@dataclass(frozen=True)
class Results:
    """Results of an evaluation in addition to the rows of its leaderboard, computed once for files and page."""

    axes: tuple[AxisResults, ...]
    """Results by condition."""
    comparison: MethodComparison
    """Profiles of the methods, and comparisons of neighbours in rank."""


def compute_results(rows: Sequence[LeaderboardRow], records: Sequence[Record]) -> Results:
    """Return the results of a leaderboard whose ``rows`` were computed from ``records``."""
    methods = [row.method for row in rows]
    return Results(by_axis(records, methods), compare_methods(records, methods))


def write_leaderboard(
    folder: str | Path,
    *,
    rows: Sequence[LeaderboardRow],
    records: Sequence[Record],
    failures: Sequence[SequenceFailure] = (),
    results: Results | None = None,
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
    results : Results, optional
        Results of ``rows`` and ``records``, if they have been computed already.

    Returns
    -------
    list of Path
        Paths of the files.

    Raises
    ------
    BadInput
        If a file cannot be written.
    """
    results = results or compute_results(rows, records)
    ranking = tables.ranking(rows)
    texts = (
        _format_json(rows, records=records, failures=failures, results=results),
        ranking.to_csv(),
        _format_page(rows, records=records, failures=failures, results=results),
        ranking.up_to(tables.INTERVALS).to_latex(),
        tables.bin_lines(results.axes).to_csv(),
        tables.profile_lines(results.comparison.profiles).to_csv(),
        tables.neighbours(results.comparison.neighbours).to_csv(),
    )
    paths = _write(folder, dict(zip(LEADERBOARD_FILES, texts, strict=True)))
    write_records(Path(folder) / RECORDS_FILE, records)
    return [*paths, Path(folder) / RECORDS_FILE]


def write_curves(folder: str | Path, curves: Sequence[AssessedCurve]) -> list[Path]:
    """Write curves.csv and measures.csv into ``folder`` and return their paths; without curves, write nothing.

    Raises BadInput if a file cannot be written.
    """
    if not curves:
        return []
    texts = {"curves.csv": tables.curves(curves).to_csv(), "measures.csv": tables.measures(curves).to_csv()}
    return _write(folder, texts)


def _write(folder: str | Path, texts: dict[str, str]) -> list[Path]:
    for name, text in texts.items():
        write_text(Path(folder) / name, text)
    return [Path(folder) / name for name in texts]


def _format_json(
    rows: Sequence[LeaderboardRow], *, records: Sequence[Record], failures: Sequence[SequenceFailure], results: Results
) -> str:
    ranking = tables.ranking(rows)
    document = {
        "format": "saf-gen leaderboard",
        "version": __version__,
        "ranked_by": RULE,
        "columns": {column.name: column.meaning for column in ranking.columns},
        "rows": [{**values, "tied": list(row.tied)} for values, row in zip(ranking.to_dicts(), rows, strict=True)],
        "intervals": {
            "unit": "scene",
            "confidence": CONFIDENCE,
            "simultaneous": {"ranks": "all rivals of a row", "others": "each interval alone"},
            "unknown": next((row.missing_reason for row in rows if row.missing_reason), None),
        },
        "axes": list(map(_axis_to_json, results.axes)),
        "profiles": [asdict(one) for one in results.comparison.profiles],
        "neighbours": tables.neighbours(results.comparison.neighbours).to_dicts(),
        "notes": notes_on(rows, records),
        "grain": [asdict(grain) for grain in grain_by_scene(records)],
        **describe_records(records),
        "machines": sorted({r.machine for r in records}),
        "failures": [{"sequence": f.sequence, "problem": f.problem} for f in failures],
    }
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def describe_records(records: Sequence[Record]) -> dict[str, Any]:
    """Return the keys of leaderboard.json that state of which data and code the records are."""
    return {
        "benchmark": sorted({r.benchmark or "" for r in records}),
        "track": sorted({r.track for r in records}),
        "rig": sorted({r.rig for r in records}),
        "data": {r.sequence: r.data for r in records},
        "code": {r.method: r.code for r in records},
        "tuning": {r.method: r.tuning for r in records if r.tuning},
        "parameters": {r.method: r.parameters for r in records},
    }


def _axis_to_json(results: AxisResults) -> dict[str, Any]:
    return {
        "axis": results.axis.name,
        "meaning": results.axis.meaning,
        "bins": [
            {"bin": one.name, "scenes": one.scenes, "sequences": one.sequences, "without": one.without}
            for one in results.bins
        ],
        "methods": {
            method: [asdict(one.results[method]) for one in results.bins] for method in results.bins[0].results
        },
    }


def _format_page(
    rows: Sequence[LeaderboardRow], *, records: Sequence[Record], failures: Sequence[SequenceFailure], results: Results
) -> str:
    ranking, comparison = tables.ranking(rows), results.comparison
    meanings = [f"- **{escape_markdown(c.header)}**: {escape_markdown(c.meaning)}\n" for c in ranking.shown]
    parts = [
        "# Leaderboard\n",
        ranking.to_markdown(),
        *([f"{escape_markdown(names)}\n"] if (names := name_list(row.method for row in rows)) else []),
        escape_markdown(" ".join(notes_on(rows, records))) + "\n",
        "".join(meanings),
    ]
    if failures:
        lines = [f"- {escape_markdown(f'{f.sequence}: {f.problem}')}\n" for f in failures]
        parts.append(f"Not read:\n\n{''.join(lines)}")
    if comparison.neighbours:
        parts.append(f"## Neighbours in rank\n\n{tables.neighbours(comparison.neighbours).to_markdown()}")
        for quantity, heading in (("error_dof", "Within depths of focus"), ("time_s", "In focus within seconds")):
            if group := [profile for profile in comparison.profiles if profile.quantity == quantity]:
                parts.append(f"## {heading}\n\n{tables.profiles(group).to_markdown()}")
    parts += [
        f"## {one.axis.title}\n\n{one.axis.meaning} Answerable success within 1 DoF (median error in DoF).\n\n"
        + tables.by_bin(one).to_markdown(explain=True)
        for one in map(keep_largest, results.axes)
        if len(one.bins) > 1
    ]
    return "\n".join(parts)
