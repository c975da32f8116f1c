"""Output of an evaluation to a folder, which replaces an earlier evaluation there and keeps other files.

All files of a new evaluation are first written to a staging folder. Renaming it to ``.evaluation.ready`` is the moment
at which the new evaluation replaces the earlier one. A run that is killed before this moment leaves the earlier
evaluation intact. After it, records are read from the renamed folder until all files have been moved; if the run is
killed, the next run moves the rest.
"""

import json
import os
import shutil
from collections.abc import Sequence, Set
from dataclasses import dataclass
from pathlib import Path

from saf_gen.benchmark.records import READY, RECORDS_FILE
from saf_gen.benchmark.results import Evaluation
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
from saf_gen.core.plain_text import escape_all_text, plural
from saf_gen.errors import BadInput, escape_controls
from saf_gen.leaderboard.files import LEADERBOARD_FILES, Results, compute_results, write_curves, write_leaderboard
from saf_gen.leaderboard.ranking import LeaderboardRow
from saf_gen.leaderboard.report.charts import make_charts
from saf_gen.leaderboard.report.delivered import Delivered
from saf_gen.leaderboard.report.page import build_page

STAGING = "evaluation"
STALE = "stale.txt"
PAGE = "index.html"
CURVES = ("curves.csv", "measures.csv")
CURVES_START = "measure,"
PAGE_MARK = "data-of-records"
MARKS = {RECORDS_FILE: '"saf-gen record ', "leaderboard.json": '"saf-gen leaderboard"'}
"""Files that say at their beginning that they are of an evaluation; its page says so, too."""
FILES = (*LEADERBOARD_FILES, RECORDS_FILE, *CURVES, PAGE)


@dataclass(frozen=True)
class WrittenEvaluation:
    """Paths that were written, and a line that names the replaced evaluation; '' if nothing was replaced."""

    paths: tuple[Path, ...]
    replaced: str


def write_evaluation(
    folder: str | Path,
    *,
    evaluation: Evaluation,
    rows: Sequence[LeaderboardRow],
    title: str,
    delivered: Delivered | None = None,
) -> WrittenEvaluation:
    """Write the tables, curves and page of an evaluation, replacing an earlier evaluation in the folder.

    Everything is first written to a staging folder: if this fails or is stopped, the earlier evaluation remains
    unchanged. Files that no evaluation wrote are kept.

    Parameters
    ----------
    folder : str or Path
        Folder to write to.
    evaluation : Evaluation
        The evaluation.
    rows : sequence of LeaderboardRow
        Rows of its leaderboard, best first.
    title : str
        Heading of the page.
    delivered : Delivered, optional
        What some methods delivered, for the page.

    Returns
    -------
    WrittenEvaluation
        Paths that were written, and a line that names the replaced evaluation.

    Raises
    ------
    BadInput
        If the disk is full or the folder cannot be written.
    """
    final = Path(folder)
    earlier = _describe_earlier(final, splits={record.split for record in evaluation.records})
    results = compute_results(rows, evaluation.records)
    try:
        with temporary_folder(final / STAGING) as part:
            staged = write_leaderboard(
                part, rows=rows, records=evaluation.records, failures=evaluation.failures, results=results
            )
            staged += write_curves(part, evaluation.curves)
            staged.append(
                write_report(part, rows=rows, evaluation=evaluation, title=title, delivered=delivered, results=results)
            )
            paths = tuple(final / path.name for path in staged)
            _publish(part, final)
    except OSError as error:
        raise unwritable(Path(error.filename2 or error.filename or final), error) from error
    return WrittenEvaluation(paths, f"replaced {earlier}" if earlier else "")


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


def write_report(
    folder: str | Path,
    *,
    evaluation: Evaluation,
    rows: Sequence[LeaderboardRow],
    title: str,
    delivered: Delivered | None = None,
    results: Results | None = None,
) -> Path:
    """Write the page of an evaluation, which is replaced atomically, and return its path.

    Parameters
    ----------
    folder : str or Path
        Folder in which index.html is written.
    evaluation : Evaluation
        The evaluation.
    rows : sequence of LeaderboardRow
        Rows of its leaderboard, best first.
    title : str
        Heading of the page.
    delivered : Delivered, optional
        What some methods delivered, for the page.
    results : Results, optional
        Results of the evaluation, if they have been computed already.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    BadInput
        If the page cannot be written.
    """
    page, original = Path(folder) / PAGE, evaluation
    evaluation, rows, title, delivered = map(escape_all_text, (evaluation, tuple(rows), title, delivered))
    if results is None or evaluation is not original:  # the results need the escaped names
        results = compute_results(rows, evaluation.records)
    charts = make_charts(evaluation, rows, comparison=results.comparison)
    text = build_page(evaluation, rows, title=title, charts=charts, delivered=delivered, results=results)
    write_text(page, text)
    return page


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
