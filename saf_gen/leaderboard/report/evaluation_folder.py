"""Writes the folder of an evaluation: an earlier evaluation in it is replaced as a whole, other files stay.

All files of a new evaluation are written to a staging folder. Renaming that to ``.evaluation.ready`` is the moment at
which the new evaluation takes the place of the earlier one: whoever is killed before leaves the earlier one whole, and
from then on records are read from there, until all files have been moved, by the next run if this one is killed.
The figures of an evaluation are those of its page.
"""

import json
import re
import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from saf_gen.benchmark.records import READY, RECORDS_FILE
from saf_gen.benchmark.results import Evaluation
from saf_gen.core.cores import defer_termination
from saf_gen.core.files import (
    rename_durably,
    sync_folder,
    temporary_folder,
    unwritable_file_error,
    write_atomically,
    write_text_atomically,
)
from saf_gen.core.plain_text import escape_all_text
from saf_gen.leaderboard import LeaderboardRow, compare_ranked_methods, write_leaderboard, write_leaderboard_curves
from saf_gen.leaderboard.figures import PDF_CREATOR, add_paper_to_figure, figure_to_pdf
from saf_gen.leaderboard.report.choose_figures import plot_report_figures
from saf_gen.leaderboard.report.page import build_report_page

STAGING = "evaluation"
STALE = "stale.txt"
PAGE, FIGURES = "index.html", "figures"
CURVES = ("curves.csv", "measures.csv")
CURVES_START = "measure,"
PAGE_MARK = "data-of-records"
_OWN_FIGURE = re.compile(rf"{FIGURES}/[\w.-]+\.(svg|pdf)")
_FIGURE = re.compile(r'<figure id="([\w.-]+)">')


@dataclass(frozen=True)
class WrittenEvaluation:
    """The paths that were written, and a line about what they replaced, else ''."""

    paths: tuple[Path, ...]
    replaced: str


def write_evaluation_report(
    folder: str | Path, *, evaluation: Evaluation, rows: Sequence[LeaderboardRow], title: str, pdf: bool = False
) -> WrittenEvaluation:
    """Write tables, curves, page and figures into ``folder``, in place of an earlier evaluation in it.

    Everything is written to a staging folder first: if that fails or is stopped, the earlier evaluation
    stays as it was. Files that no evaluation wrote stay.

    Raises BadInput where the disk is full or the folder cannot be written.
    """
    final = Path(folder)
    earlier = _describe_earlier(final)
    try:
        with temporary_folder(final / STAGING) as part:
            staged = write_leaderboard(part, rows=rows, records=evaluation.records, failures=evaluation.failures)
            staged += write_leaderboard_curves(part, evaluation.curves)
            staged += write_report(part, rows=rows, evaluation=evaluation, title=title, pdf=pdf)
            paths = tuple(final / path.relative_to(part) for path in staged)
            _publish(part, final)
    except OSError as error:
        raise unwritable_file_error(Path(error.filename2 or error.filename or final), error) from error
    return WrittenEvaluation(paths, f"replaced {earlier}" if earlier else "")


def write_report(
    folder: str | Path, *, evaluation: Evaluation, rows: Sequence[LeaderboardRow], title: str, pdf: bool = False
) -> list[Path]:
    """Draw the figures, and write index.html and each figure as figures/NAME.svg into ``folder``.

    ``pdf`` writes each as figures/NAME.pdf too, a column of a paper wide. Each file is replaced at once. Returns the
    path of the page, and of the folder of figures if there is one.
    Raises BadInput where a file cannot be written.
    """
    out = Path(folder)
    evaluation, rows, title = (escape_all_text(item) for item in (evaluation, tuple(rows), title))
    comparison = compare_ranked_methods(evaluation.records, [row.method for row in rows])
    report_figures = plot_report_figures(evaluation, rows, comparison=comparison)
    for figure in report_figures:
        write_text_atomically(out / FIGURES / f"{figure.name}.svg", add_paper_to_figure(figure.svg))
        if pdf:
            with write_atomically(out / FIGURES / f"{figure.name}.pdf") as file:
                file.write_bytes(figure_to_pdf(figure.figure))
    text = build_report_page(
        rows,
        title=title,
        records=evaluation.records,
        curves=evaluation.curves,
        failures=evaluation.failures,
        report_figures=report_figures,
        plugins=evaluation.plugins,
        comparison=comparison,
    )
    write_text_atomically(out / PAGE, text)
    return [out / PAGE, *([out / FIGURES] if report_figures else [])]


def _describe_earlier(folder: Path) -> str:
    """Return a phrase about the evaluation in the folder; '' where there is none."""
    try:
        moving = folder / READY / RECORDS_FILE
        with (moving if moving.is_file() else folder / RECORDS_FILE).open("rb") as lines:
            methods = {json.loads(line)["method"] for line in lines}
    except (FileNotFoundError, NotADirectoryError):
        return ""
    except (OSError, ValueError, LookupError, TypeError):  # from another version, or damaged
        return "an earlier evaluation that cannot be read"
    return f"the earlier evaluation of {len(methods)} method{'' if len(methods) == 1 else 's'}"


def _publish(part: Path, final: Path) -> None:
    """Put the files in ``part`` in the place of the evaluation in ``final``; Ctrl-C and SIGTERM wait for that."""
    with defer_termination():
        _finish_publishing(final)  # of a run that was killed
        names = _list_staged(part)
        for folder in {name.parent for name in names}:
            (final / folder).mkdir(parents=True, exist_ok=True)
        own = [path.relative_to(final) for path in _list_own_files(final)]
        stale = [str(name) for name in own if name not in names]
        write_text_atomically(part / STALE, "\n".join(stale))
        rename_durably(part, final / READY)
        _finish_publishing(final)


def _finish_publishing(final: Path) -> None:
    """Move what is ready to its place: first the page, which lists the figures; last the records."""
    ready = final / READY
    if not ready.is_dir():
        return
    if (ready / STALE).is_file():  # it goes last: without it all is done but for an empty folder
        for name in _read_text(ready / STALE).splitlines():
            if name in CURVES or _OWN_FIGURE.fullmatch(name):  # the folder may be a stranger's
                (final / name).unlink(missing_ok=True)
        staged_files = _list_staged(ready)
        for staged in staged_files:
            (ready / staged).replace(final / staged)
        for folder in {final, *((final / staged).parent for staged in staged_files)}:
            sync_folder(folder)
        (ready / STALE).unlink()
    shutil.rmtree(ready)
    with suppress(OSError):  # foreign figures are in it, or there is none
        (final / FIGURES).rmdir()


def _list_staged(part: Path) -> list[Path]:
    """Return the names of the files of an evaluation in the order in which they are moved."""
    names = [path.relative_to(part) for path in part.rglob("*") if path.is_file() and path.name != STALE]
    return sorted(names, key=lambda name: (name.name == RECORDS_FILE, name.name != PAGE, name))


def _list_own_files(folder: Path) -> list[Path]:
    """Return the files that not every evaluation writes: tables of curves, and the figures of the page."""
    curves = [folder / name for name in CURVES if _read_text(folder / name).startswith(CURVES_START)]
    text = _read_text(folder / PAGE)
    figures = _FIGURE.findall(text) if PAGE_MARK in text else []
    return [
        *curves,
        *(folder / FIGURES / f"{name}.svg" for name in figures),
        *(path for name in figures if _is_own_pdf(path := folder / FIGURES / f"{name}.pdf")),
    ]


def _is_own_pdf(path: Path) -> bool:
    """Return whether a PDF is one of ours: people may have made their own of our figures, under the same names."""
    try:
        return f"/Creator ({PDF_CREATOR})".encode() in path.read_bytes()
    except OSError:
        return False


def _read_text(path: Path) -> str:
    """Return the text of a file; '' where there is none or it is no text."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""
