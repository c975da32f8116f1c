"""The report of an evaluation: one page for a browser, and its figures as files."""

from collections.abc import Sequence
from pathlib import Path

from saf_gen.contest.results import Evaluation
from saf_gen.dataset import write_text
from saf_gen.figures import on_paper
from saf_gen.leaderboard import Row
from saf_gen.report.page import page
from saf_gen.report.pictures import Picture, draw

__all__ = ["Picture", "draw", "page", "write_report"]


def write_report(
    folder: str | Path, *, evaluation: Evaluation, rows: Sequence[Row], title: str
) -> list[Path]:
    """Draw the figures and write index.html, and each figure as figures/NAME.svg, into ``folder``.

    Returns the page and the folder of the figures, where there are any. Each file is replaced at once;
    BadInput where that fails.
    """
    out = Path(folder)
    pictures = draw(evaluation, rows)
    for picture in pictures:
        write_text(out / "figures" / f"{picture.name}.svg", on_paper(picture.svg))
    text = page(
        rows,
        title=title,
        records=evaluation.records,
        sweeps=evaluation.sweeps,
        failures=evaluation.failures,
        pictures=pictures,
    )
    write_text(out / "index.html", text)
    return [out / "index.html", *([out / "figures"] if pictures else [])]
