"""Output of an evaluation to a folder, which replaces an earlier evaluation there and keeps other files.

There are JSON and CSV for programs, and Markdown, LaTeX and a page for readers.
All files of a new evaluation are first written to a staging folder. Renaming it to ``.evaluation.ready`` is the moment
at which the new evaluation replaces the earlier one. A run that is killed before this moment leaves the earlier
evaluation intact. After it, records are read from the renamed folder until all files have been moved; if the run is
killed, the next run moves the rest.
"""

import json
import os
import shutil
from collections.abc import Set
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from saf_gen import __version__
from saf_gen.benchmark.records import READY, RECORDS_FILE, write_records
from saf_gen.core.cores import defer_termination
from saf_gen.core.files import (
    read_start,
    refuse_link,
    rename_durably,
    sync_folder,
    temporary_folder,
    unwritable,
    write_text,
)
from saf_gen.core.plain_text import escape_markdown, plural
from saf_gen.errors import BadInput, escape_controls
from saf_gen.leaderboard import tables
from saf_gen.leaderboard.board import Leaderboard
from saf_gen.leaderboard.intervals import CONFIDENCE
from saf_gen.leaderboard.ranking import RULE
from saf_gen.leaderboard.report.charts import make_charts
from saf_gen.leaderboard.report.page import build_page
from saf_gen.leaderboard.report.pictures import Delivered
from saf_gen.leaderboard.results import AxisResults, describe_records, list_names

STAGING = "evaluation"
STALE = "stale.txt"
PAGE = "index.html"
CURVES = ("curves.csv", "measures.csv")
CURVES_START = "measure,"
PAGE_MARK = "data-of-records"
MARKS = {RECORDS_FILE: '"saf-gen record ', "leaderboard.json": '"saf-gen leaderboard"'}
"""Files that say at their beginning that they are of an evaluation; its page says so, too."""
TABLES = (
    *("leaderboard.json", "leaderboard.csv", "leaderboard.md", "leaderboard.tex"),
    *("axes.csv", "profiles.csv", "neighbours.csv"),
)
FILES = (*TABLES, RECORDS_FILE, *CURVES, PAGE)


@dataclass(frozen=True)
class WrittenEvaluation:
    """The page, and a line that names the replaced evaluation; '' if nothing was replaced."""

    page: Path
    replaced: str


def write_evaluation(
    folder: str | Path, board: Leaderboard, *, title: str, delivered: Delivered | None = None
) -> WrittenEvaluation:
    """Write the records, tables, curves and page of an evaluation, replacing an earlier evaluation in the folder.

    Everything is first written to a staging folder: if this fails or is stopped, the earlier evaluation remains
    unchanged. Files that no evaluation wrote are kept. None becomes null in JSON and an empty field in CSV.

    Parameters
    ----------
    folder : str or Path
        Folder to write to.
    board : Leaderboard
        The leaderboard of the evaluation.
    title : str
        Heading of the page.
    delivered : Delivered, optional
        What some methods delivered, for the page.

    Returns
    -------
    WrittenEvaluation
        The page, and a line that names the replaced evaluation.

    Raises
    ------
    BadInput
        If the disk is full or the folder cannot be written.
    """
    final = Path(folder)
    earlier = _describe_earlier(final, splits={record.what.split for record in board.records})
    texts = format_tables(board)
    texts[PAGE] = build_page(board, title=title, charts=make_charts(board), delivered=delivered)
    try:
        with temporary_folder(final / STAGING) as part:
            for name, text in texts.items():
                write_text(part / name, text)
            write_records(part / RECORDS_FILE, board.records)
            _publish(part, final)
    except OSError as error:
        raise unwritable(Path(error.filename2 or error.filename or final), error) from error
    return WrittenEvaluation(final / PAGE, f"replaced {earlier}" if earlier else "")


def check_replaceable(folder: Path) -> None:
    """Raise BadInput if an evaluation in this folder would replace links, or files that no evaluation wrote.

    A folder is that of an evaluation if its records, its ``leaderboard.json`` or its page say so.
    """
    refuse_link(folder)
    present = [path for name in FILES if os.path.lexists(path := folder / name)]
    for path in present:
        refuse_link(path)
    is_evaluation = (
        (folder / READY).is_dir()
        or any(mark in read_start(folder / name) for name, mark in MARKS.items())
        or PAGE_MARK in _read_text(folder / PAGE)
    )
    if present and not is_evaluation:
        raise BadInput(
            f"{present[0]} exists, and no evaluation wrote it",
            allowed="a folder that is new, or holds an evaluation or other files",
            hint="give another folder with --out, or move it away",
        )


def format_tables(board: Leaderboard) -> dict[str, str]:
    """Return the texts of the files of a leaderboard except its records and page, by name."""
    texts = (
        _format_json(board),
        board.ranking.to_csv(),
        _format_markdown(board),
        board.ranking.up_to(tables.INTERVALS).to_latex(),
        tables.bin_lines(board.axes).to_csv(),
        tables.profile_lines(board.comparison.profiles).to_csv(),
        board.neighbours.to_csv(),
    )
    curves = board.evaluation.curves
    of_curves = (tables.curves(curves).to_csv(), board.measures.to_csv()) if curves else ()
    return dict(zip(TABLES, texts, strict=True)) | dict(zip(CURVES, of_curves, strict=False))


def _format_json(board: Leaderboard) -> str:
    document = {
        "format": "saf-gen leaderboard",
        "version": __version__,
        "ranked_by": RULE,
        "columns": {column.name: column.meaning for column in board.ranking.columns},
        "rows": [{**values, "tied": row.tied} for values, row in zip(board.to_dicts(), board, strict=True)],
        "intervals": {
            "unit": "scene",
            "confidence": CONFIDENCE,
            "simultaneous": {"ranks": "all rivals of a row", "others": "each interval alone"},
            "unknown": next((row.missing_reason for row in board if row.missing_reason), None),
        },
        "axes": list(map(_axis_to_json, board.axes)),
        "profiles": [asdict(one) for one in board.comparison.profiles],
        "neighbours": board.neighbours.to_dicts(),
        "notes": [*board.lead, *board.notes],
        "agreements": [{**asdict(one), "share": one.share} for one in board.agreements],
        "grain": [asdict(grain) for grain in board.grain],
        **describe_records(board.records),
        "machines": sorted({r.who.machine for r in board.records}),
        "failures": [asdict(failure) for failure in board.evaluation.failures],
    }
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


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


def _format_markdown(board: Leaderboard) -> str:
    ranking, comparison, failures = board.ranking, board.comparison, board.evaluation.failures
    meanings = [f"- **{escape_markdown(c.header)}**: {escape_markdown(c.meaning)}\n" for c in ranking.shown]
    parts = [
        "# Leaderboard\n",
        *map(escape_markdown, [f"{line}\n" for line in board.lead]),
        *([board.agreement.to_markdown()] if len(board.agreements) > 1 else []),
        ranking.to_markdown(),
        *([f"{escape_markdown(list_names(board.names))}\n"] if board.names else []),
        escape_markdown(" ".join([*board.lead, *board.notes])) + "\n",
        "".join(meanings),
    ]
    if failures:
        lines = [f"- {escape_markdown(f'{f.sequence}: {f.problem}')}\n" for f in failures]
        parts.append(f"Not read:\n\n{''.join(lines)}")
    if comparison.neighbours:
        parts.append(f"## Neighbours in rank\n\n{board.neighbours.to_markdown()}")
        for quantity, heading in (("error_dof", "Within depths of focus"), ("time_s", "In focus within seconds")):
            if group := [profile for profile in comparison.profiles if profile.quantity == quantity]:
                parts.append(f"## {heading}\n\n{tables.profiles(group).to_markdown()}")
    parts += [
        f"## {axis.title}\n\n{axis.meaning} Answerable success within 1 DoF (median error in DoF).\n\n"
        + table.to_markdown(explain=True)
        for axis, table in board.conditions
    ]
    return "\n".join(parts)


def _describe_earlier(folder: Path, *, splits: Set[str | None]) -> str:
    """Return a phrase that describes the evaluation in the folder, and its splits unless they are the same ``splits``.

    It is '' if there is no evaluation.
    """
    try:
        moving = folder / READY / RECORDS_FILE
        with (moving if moving.is_file() else folder / RECORDS_FILE).open("rb") as lines:
            found = {(record["method"], record.get("split")) for record in map(json.loads, lines)}
    except (FileNotFoundError, NotADirectoryError):
        return ""
    except (OSError, ValueError, LookupError, TypeError, AttributeError):  # from another version, or damaged
        return "an earlier evaluation that cannot be read"
    earlier = {split for _, split in found}
    of = f"the earlier evaluation of {plural(len({method for method, _ in found}), 'method')}"
    return of if earlier == splits else escape_controls(f"{of} on {' and '.join(sorted(map(str, earlier))):.200}")


def _publish(part: Path, final: Path) -> None:
    """Replace the evaluation in ``final`` by the files in ``part``; Ctrl-C and SIGTERM are deferred meanwhile."""
    with defer_termination():
        _finish_publishing(final)  # completes a run that was killed
        names = _list_staged(part)
        stale = [name for name in CURVES if name not in names and _read_text(final / name).startswith(CURVES_START)]
        write_text(part / STALE, "\n".join(stale))
        rename_durably(part, final / READY)
        _finish_publishing(final)


def _finish_publishing(final: Path) -> None:
    """Move the ready files to their final names: first the page, last the records."""
    ready = final / READY
    if not ready.is_dir():
        return
    if (ready / STALE).is_file():  # this file is removed last; without it, only an empty folder is left
        for name in _read_text(ready / STALE).splitlines():
            if name in CURVES:  # the folder may be untrusted
                (final / name).unlink(missing_ok=True)
        for name in _list_staged(ready):
            (ready / name).replace(final / name)
        sync_folder(final)
        (ready / STALE).unlink()
    shutil.rmtree(ready)


def _list_staged(part: Path) -> list[str]:
    """Return the names of the files of an evaluation in the order in which they are moved."""
    names = {path.name for path in part.iterdir()} - {STALE}
    return sorted(names, key=lambda name: (name == RECORDS_FILE, name != PAGE, name))


def _read_text(path: Path) -> str:
    """Return the text of a file; '' if it does not exist or is not UTF-8 text."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""
