"""The files of the command ``paper``: figures as SVG and PNG, curves, claims, records, and a page to be printed."""

from collections.abc import Mapping
from html import escape
from operator import itemgetter
from pathlib import Path

from matplotlib.figure import Figure

from saf_gen.addons.paper.claims import RULE
from saf_gen.addons.paper.conditions import PaperRun, curve_rows
from saf_gen.benchmark.records import RECORDS_FILE, write_records
from saf_gen.core.figure_style import VARIABLES, inline_svg, plot_to_svg
from saf_gen.core.files import atomic_file, read_start, refuse_link, write_text
from saf_gen.core.table import Column, Table
from saf_gen.errors import BadInput
from saf_gen.leaderboard.report.charts import normalise

PAGE, CURVES, CLAIMS, MARK = "paper.html", "curves.csv", "claims.md", "saf-gen paper"
FIGURES = ("figure-4", "figure-5", "figure-6", "figure-7", "naive")
FILES = (PAGE, CURVES, CLAIMS, RECORDS_FILE, *(f"{name}.{kind}" for name in FIGURES for kind in ("svg", "png")))
TITLES = {name: f"Figure {name[-1]}" for name in FIGURES} | {"naive": "Section 4.3"}
CURVE_COLUMNS = [
    Column(name, itemgetter(name))
    for name in (
        *("sequence", "scene", "motion", "light", "truth"),
        *("measure", "frame", "position", "rate", "score", "normalised"),
    )
]
STYLE = (
    ":root{{{}}}body{{font:15px/1.5 sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:var(--ink)}}"
    "svg{{width:100%;height:auto}}figure{{margin:2rem 0;break-inside:avoid}}table{{border-collapse:collapse}}"
    "th,td{{text-align:left;vertical-align:top;padding:.3rem .6rem;border-bottom:1px solid var(--area)}}"
    "@media print{{body{{font-size:9pt;margin:0;max-width:none}}tr{{break-inside:avoid}}}}"
)


def check_replaceable(folder: Path) -> None:
    """Raise BadInput if the folder is a link, or holds files and no page of ``saf-gen paper``."""
    refuse_link(folder)
    if folder.is_dir() and any(folder.iterdir()) and MARK not in read_start(folder / PAGE):
        hint = "give another folder with --out, or move them away"
        raise BadInput(f"{folder} holds files that saf-gen paper did not write", hint=hint)


def write_paper(
    folder: Path, run: PaperRun, *, figures: Mapping[str, tuple[Figure, str]], claims: Table, title: str
) -> list[Path]:
    """Write all files, the page first, because it tells whose they are, and return their paths.

    Figures that the dataset does not allow are removed. Raises BadInput if a file cannot be written.
    """
    drawn = {name: plot_to_svg(figure, name=name) for name, (figure, _) in figures.items()}
    parts = [f"<h2>Claims</h2>{_format_table(claims)}<p>{escape(RULE)}</p>"]
    parts += [
        f"<figure>{inline_svg(drawn[name], label=caption)}"
        f"<figcaption><b>{TITLES[name]}.</b> {escape(caption)}</figcaption></figure>"
        for name, (_, caption) in figures.items()
    ]
    style = STYLE.format(";".join(f"{name}:{colour}" for colour, name in VARIABLES.items()))
    head = f'<!doctype html><html lang="en"><meta charset="utf-8"><meta name="generator" content="{MARK}">'
    head += f"<title>{escape(title)}</title><style>{style}</style><h1>{escape(title)}</h1>"
    cite = (
        "<p>After <i>Intensity-Robust Autofocus for Spike Camera</i>, CVPR 2024, doi:10.1109/CVPR52733.2024.02363.</p>"
    )
    write_text(folder / PAGE, head + cite + "".join(parts) + "</html>\n")
    write_text(folder / CURVES, Table(CURVE_COLUMNS, curve_rows(run, normalise)).to_csv())
    write_text(folder / CLAIMS, claims.to_markdown())
    write_records(folder / RECORDS_FILE, run.records)
    for name, (figure, _) in figures.items():
        write_text(folder / f"{name}.svg", drawn[name])
        with atomic_file(folder / f"{name}.png") as part:
            figure.savefig(part, format="png")
    for name in set(FIGURES) - set(figures):
        for kind in ("svg", "png"):
            (folder / f"{name}.{kind}").unlink(missing_ok=True)
    return [path for name in FILES if (path := folder / name).exists()]


def _format_table(table: Table) -> str:
    lines = ["".join(f"<th>{escape(c.header)}" for c in table.shown)]
    lines += ["".join(f"<td>{escape(c.text(row))}" for c in table.shown) for row in table.rows]
    return f"<table>{''.join(f'<tr>{line}' for line in lines)}</table>"
