"""Common parts of a leaderboard's figures: an empty figure with a title, labels, and output as PDF."""

import io
import textwrap

from matplotlib.backends.backend_pdf import Op, PdfFile, RendererPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from saf_gen.core.figure_style import COLUMN, PAPER, STYLE, WIDTH, use_plot_style

PDF_CREATOR = "saf-gen"
PREDICTIONS_LABEL = "predictions"
"""Label in place of a search, for answers of another program."""
MAX_LABEL_CHARACTERS = 34
"""Largest length of a method name that labels a row, in characters."""
TITLE, TITLE_LINE = 52, 0.16  # characters per line of the title; height of each further line, in inches


def create_leaderboard_figure(inches: float, *, title: str) -> Figure:
    """Return an empty figure, WIDTH wide and ``inches`` high, with its title on the left; a long title adds height."""
    lines = textwrap.wrap(title, TITLE) or [""]
    figure = Figure(figsize=(WIDTH, inches + TITLE_LINE * (len(lines) - 1)), dpi=72, layout="constrained")
    FigureCanvasSVG(figure)
    figure.suptitle("\n".join(lines), x=0.012, ha="left", fontsize=9.5, fontweight="bold")
    return figure


def describe_figure_omissions(*counts: tuple[int, int, str]) -> str:
    """Return a note on items that a figure leaves out, from (drawn, all, noun) of each kind; '' if it draws all."""
    parts = [f"{drawn} of {total} {noun}" for drawn, total, noun in counts if drawn < total]
    return f"Drawn: the first {', the first '.join(parts)}" if parts else ""


def shorten_figure_label(name: str, limit: int) -> str:
    """Return the name; if it is longer than ``limit`` characters, its middle is replaced by an ellipsis."""
    if len(name) <= limit:
        return name
    end = (limit - 1) // 2
    return f"{name[: limit - 1 - end]}…{name[len(name) - end :]}"


def split_figure_label(method: str) -> tuple[str, str]:
    """Return the measure and the search of a method with their options, or the name and '' for predictions."""
    measure, _, search = method.partition("+")
    return measure, search


def figure_to_pdf(figure: Figure) -> bytes:
    """Return the figure as PDF with embedded fonts, scaled to the width of a column of a paper (3.5 inches)."""
    width, height = (72 * side for side in figure.get_size_inches())
    scale, buffer = 72 * COLUMN / width, io.BytesIO()
    with use_plot_style({**STYLE, "pdf.fonttype": 42}):
        file = PdfFile(buffer, metadata={"CreationDate": None, "Creator": PDF_CREATOR})
        try:
            figure.set_dpi(72)
            file.newPage(scale * width / 72, scale * height / 72)
            file.width, file.height = width / 72, height / 72  # lines are clipped to the page before scaling
            file.output(scale, 0, 0, scale, 0, 0, Op.concat_matrix)  # matplotlib itself cannot scale text and lines
            renderer = RendererPdf(file, 72, height / 72, width / 72)
            figure.draw(renderer)
            renderer.finalize()
            file.finalize()
        finally:
            file.close()
        return buffer.getvalue()


def add_paper_to_figure(svg: str) -> str:
    """Return the SVG with a white background, for viewers whose background is dark."""
    end = svg.index(">", svg.index("<svg")) + 1
    return f'{svg[:end]}\n <rect width="100%" height="100%" fill="{PAPER}"/>{svg[end:]}'
