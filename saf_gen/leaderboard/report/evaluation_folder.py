"""Output of an evaluation to a folder, which replaces an earlier evaluation there and keeps other files.

All files of a new evaluation are first written to a staging folder. Renaming it to ``.evaluation.ready`` is the moment
at which the new evaluation replaces the earlier one. A run that is killed before this moment leaves the earlier
evaluation intact. After it, records are read from the renamed folder until all files have been moved; if the run is
killed, the next run moves the rest. A page lists the figures of its evaluation, so that the next one can remove them.
"""

import json
import os
import re
import shutil
from collections.abc import Sequence, Set
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from saf_gen.benchmark.records import READY, RECORDS_FILE
from saf_gen.benchmark.results import Evaluation
from saf_gen.core.cores import defer_termination
from saf_gen.core.files import (
    atomic_file,
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
from saf_gen.leaderboard.method_comparison import MethodComparison
from saf_gen.leaderboard.ranking import LeaderboardRow
from saf_gen.leaderboard.report.charts import make_charts
from saf_gen.leaderboard.report.delivered import Delivered
from saf_gen.leaderboard.report.page import build_page

PDF_CREATOR = "saf-gen"
STAGING = "evaluation"
STALE = "stale.txt"
PAGE, FIGURES = "index.html", "figures"
CURVES = ("curves.csv", "measures.csv")
CURVES_START = "measure,"
PAGE_MARK = "data-of-records"
MARKS = {RECORDS_FILE: '"saf-gen record ', "leaderboard.json": '"saf-gen leaderboard"'}
"""Files that say at their beginning that they are of an evaluation; its page says so, too."""
FILES = (*LEADERBOARD_FILES, RECORDS_FILE, *CURVES, PAGE)
_FIGURE_FILE = re.compile(rf"{FIGURES}/[\w.-]+\.(svg|pdf)")
_FIGURE = re.compile(rf'href="{FIGURES}/([\w.-]+)\.svg"')


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
    figures: bool = False,
    pdf: bool = False,
    delivered: Delivered | None = None,
) -> WrittenEvaluation:
    """Write the tables, curves, page and figures of an evaluation, replacing an earlier evaluation in the folder.

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
    figures : bool, default False
        Whether to draw printed figures, too, as figures/NAME.svg.
    pdf : bool, default False
        Whether to write each figure as PDF as well, as wide as a column of a paper; it implies ``figures``.
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
            staged += write_report(
                part,
                rows=rows,
                evaluation=evaluation,
                title=title,
                figures=figures,
                pdf=pdf,
                delivered=delivered,
                results=results,
            )
            paths = tuple(final / path.relative_to(part) for path in staged)
            _publish(part, final)
    except OSError as error:
        raise unwritable(Path(error.filename2 or error.filename or final), error) from error
    return WrittenEvaluation(paths, f"replaced {earlier}" if earlier else "")


def check_replaceable(folder: Path) -> None:
    """Raise BadInput if an evaluation in this folder would replace links, or files that no evaluation wrote.

    A folder is that of an evaluation if its records, its ``leaderboard.json`` or its page say so.
    """
    refuse_link(folder)
    present = [path for name in (*FILES, FIGURES) if os.path.lexists(path := folder / name)]
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
    figures: bool = False,
    pdf: bool = False,
    delivered: Delivered | None = None,
    results: Results | None = None,
) -> list[Path]:
    """Write the page of an evaluation and, if they are asked for, its figures. Each file is replaced atomically.

    Parameters
    ----------
    folder : str or Path
        Folder in which index.html and figures/ are written.
    evaluation : Evaluation
        The evaluation.
    rows : sequence of LeaderboardRow
        Rows of its leaderboard, best first.
    title : str
        Heading of the page.
    figures : bool, default False
        Whether to draw printed figures, too, as figures/NAME.svg.
    pdf : bool, default False
        Whether to write each figure as figures/NAME.pdf as well, as wide as a column of a paper; it implies
        ``figures``.
    delivered : Delivered, optional
        What some methods delivered, for the page.
    results : Results, optional
        Results of the evaluation, if they have been computed already.

    Returns
    -------
    list of Path
        The page, and the folder of figures if there are any.

    Raises
    ------
    BadInput
        If a file cannot be written.
    """
    out = Path(folder)
    original = evaluation
    evaluation, rows, title, delivered = map(escape_all_text, (evaluation, tuple(rows), title, delivered))
    if results is None or evaluation is not original:  # the results need the escaped names
        results = compute_results(rows, evaluation.records)
    names = _draw_figures(out, evaluation, rows=rows, comparison=results.comparison, pdf=pdf) if figures or pdf else []
    charts = make_charts(evaluation, rows, comparison=results.comparison)
    text = build_page(evaluation, rows, title=title, charts=charts, figures=names, delivered=delivered, results=results)
    write_text(out / PAGE, text)
    return [out / PAGE, *([out / FIGURES] if names else [])]


def _draw_figures(
    out: Path, evaluation: Evaluation, *, rows: Sequence[LeaderboardRow], comparison: MethodComparison, pdf: bool
) -> list[str]:
    """Write the printed figures and return their names."""
    # Imported late because loading matplotlib takes a second.
    from saf_gen.leaderboard.figures.figure import add_paper, to_pdf
    from saf_gen.leaderboard.report.choose_figures import plot_figures

    drawn = plot_figures(evaluation, rows, comparison=comparison)
    for figure in drawn:
        write_text(out / FIGURES / f"{figure.name}.svg", add_paper(figure.svg))
        if pdf:
            with atomic_file(out / FIGURES / f"{figure.name}.pdf") as file:
                file.write_bytes(to_pdf(figure.figure, creator=PDF_CREATOR))
    return [figure.name for figure in drawn]


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
        for folder in {name.parent for name in names}:
            (final / folder).mkdir(parents=True, exist_ok=True)
        existing = [path.relative_to(final) for path in _list_evaluation_files(final)]
        stale = [str(name) for name in existing if name not in names]
        write_text(part / STALE, "\n".join(stale))
        rename_durably(part, final / READY)
        _finish_publishing(final)


def _finish_publishing(final: Path) -> None:
    """Move the ready files to their final names: first the page, which lists the figures; last the records."""
    ready = final / READY
    if not ready.is_dir():
        return
    if (ready / STALE).is_file():  # this file is removed last; without it, only an empty folder is left
        for name in _read_text(ready / STALE).splitlines():
            if name in CURVES or _FIGURE_FILE.fullmatch(name):  # the folder may be untrusted
                (final / name).unlink(missing_ok=True)
        staged_files = _list_staged(ready)
        for staged in staged_files:
            (ready / staged).replace(final / staged)
        for folder in {final, *((final / staged).parent for staged in staged_files)}:
            sync_folder(folder)
        (ready / STALE).unlink()
    shutil.rmtree(ready)
    with suppress(OSError):  # the folder holds other files, or does not exist
        (final / FIGURES).rmdir()


def _list_staged(part: Path) -> list[Path]:
    """Return the relative paths of the files of an evaluation in the order in which they are moved."""
    names = [path.relative_to(part) for path in part.rglob("*") if path.is_file() and path.name != STALE]
    return sorted(names, key=lambda name: (name.name == RECORDS_FILE, name.name != PAGE, name))


def _list_evaluation_files(folder: Path) -> list[Path]:
    """Return the existing files that only some evaluations write: tables of curves, and the figures of the page."""
    curves = [folder / name for name in CURVES if _read_text(folder / name).startswith(CURVES_START)]
    text = _read_text(folder / PAGE)
    figures = _FIGURE.findall(text) if PAGE_MARK in text else []
    return [
        *curves,
        *(folder / FIGURES / f"{name}.svg" for name in figures),
        *(path for name in figures if _is_pdf_by_saf_gen(path := folder / FIGURES / f"{name}.pdf")),
    ]


def _is_pdf_by_saf_gen(path: Path) -> bool:
    """Return whether saf_gen made a PDF; users may have saved PDFs of the figures under the same names."""
    try:
        return f"/Creator ({PDF_CREATOR})".encode() in path.read_bytes()
    except OSError:
        return False


def _read_text(path: Path) -> str:
    """Return the text of a file; '' if it does not exist or is not UTF-8 text."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""
