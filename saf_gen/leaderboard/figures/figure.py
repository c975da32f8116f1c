"""Common parts of figures: an empty figure with a title, labels, the legend below a figure, and output as PDF."""

import io
import math
import textwrap
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from matplotlib.backends.backend_pdf import Op, PdfFile, RendererPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.legend_handler import HandlerTuple
from matplotlib.textpath import TextToPath

from saf_gen.core.figure_style import COLUMN, PAPER, SOFT, STYLE, WIDTH, use_plot_style

MAX_LABEL_CHARACTERS = 34
"""Largest length of a method name that labels a row, in characters."""
TITLE, TITLE_LINE = 52, 0.16  # characters per line of the title; height of each further line, in inches
LINE = 0.16  # inches
MAX_LEGEND_CHARACTERS = 52
"""Largest length of a name, in characters; longer names are shortened in the middle."""
HANDLE, GAP = 2.8, 1.2  # width of a sample, and of the gap between columns, in font sizes
_WIDTHS = TextToPath()


def new_figure(inches: float, *, title: str) -> Figure:
    """Return an empty figure, WIDTH wide and ``inches`` high, with its title on the left; a long title adds height."""
    lines = textwrap.wrap(title, TITLE) or [""]
    figure = Figure(figsize=(WIDTH, inches + TITLE_LINE * (len(lines) - 1)), dpi=72, layout="constrained")
    FigureCanvasSVG(figure)
    figure.suptitle("\n".join(lines), x=0.012, ha="left", fontsize=9.5, fontweight="bold")
    return figure


def describe_omissions(*counts: tuple[int, int, str]) -> str:
    """Return a note on items that a figure leaves out, from (drawn, all, noun) of each kind; '' if it draws all."""
    parts = [f"{drawn} of {total} {noun}" for drawn, total, noun in counts if drawn < total]
    return f"Drawn: the first {', the first '.join(parts)}" if parts else ""


def shorten(name: str, limit: int) -> str:
    """Return the name; if it is longer than ``limit`` characters, its middle is replaced by an ellipsis."""
    if len(name) <= limit:
        return name
    end = (limit - 1) // 2
    return f"{name[: limit - 1 - end]}…{name[len(name) - end :]}"


def legend_height(names: Sequence[str], *, columns: int = 2, note: str = "") -> float:
    """Return the height of the legend that add_legend draws, in inches."""
    return LINE * (math.ceil(len(names) / _count_columns(names, columns)) + bool(note))


def add_legend(
    figure: Figure, handles: Sequence[Any], *, names: Sequence[str], columns: int = 2, note: str = ""
) -> None:
    """Add samples and names below the figure, in up to ``columns`` columns, with ``note`` above them."""
    legend = figure.legend(
        list(handles),
        [shorten(name, MAX_LEGEND_CHARACTERS) for name in names],
        handler_map={tuple: HandlerTuple(ndivide=1, pad=0)},
        loc="outside lower center",
        ncols=_count_columns(names, columns),
        handlelength=HANDLE,
        columnspacing=GAP,
        labelspacing=0.35,
        title=note or None,
        title_fontsize=STYLE["legend.fontsize"],
        alignment="left",
    )
    legend.get_title().set_color(SOFT)


def _count_columns(names: Sequence[str], limit: int) -> int:
    """Return the number of columns that fit; matplotlib fills them in turn, each as wide as its widest name."""
    size = STYLE["legend.fontsize"]
    font = FontProperties(family=STYLE["font.family"], size=size)
    widths = [_WIDTHS.get_text_width_height_descent(shorten(n, MAX_LEGEND_CHARACTERS), font, False)[0] for n in names]
    for columns in range(min(limit, len(names)), 1, -1):
        rows, extra = divmod(len(widths), columns)
        ends = [rows * c + min(c, extra) for c in range(columns + 1)]
        widest = [max(widths[a:b]) for a, b in pairwise(ends)]
        # The browser may use a font that is up to a tenth wider.
        if sum(1.1 * w + size * (HANDLE + GAP + 0.8) for w in widest) <= 72 * WIDTH:
            return columns
    return 1


def to_pdf(figure: Figure, *, creator: str) -> bytes:
    """Return the figure as PDF with embedded fonts, scaled to the width of a column of a paper (3.5 inches)."""
    width, height = (72 * side for side in figure.get_size_inches())
    scale, buffer = 72 * COLUMN / width, io.BytesIO()
    with use_plot_style({**STYLE, "pdf.fonttype": 42}):
        file = PdfFile(buffer, metadata={"CreationDate": None, "Creator": creator})
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


def add_paper(svg: str) -> str:
    """Return the SVG with a white background, for viewers whose background is dark."""
    end = svg.index(">", svg.index("<svg")) + 1
    return f'{svg[:end]}\n <rect width="100%" height="100%" fill="{PAPER}"/>{svg[end:]}'
