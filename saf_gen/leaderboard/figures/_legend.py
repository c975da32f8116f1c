"""The legend below a figure, with as many columns as fit and a note on what the figure leaves out."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.legend_handler import HandlerTuple
from matplotlib.textpath import TextToPath

from saf_gen.core.figure_style import SOFT, STYLE, WIDTH
from saf_gen.leaderboard.figures._figure import shorten_figure_label

LINE = 0.16  # inches
MAX_LEGEND_CHARACTERS = 52
"""Largest length of a name, in characters; longer names are shortened in the middle."""
HANDLE, GAP = 2.8, 1.2  # width of a sample, and of the gap between columns, in font sizes
_WIDTHS = TextToPath()


def figure_legend_height(names: Sequence[str], *, columns: int = 2, note: str = "") -> float:
    """Return the height of the legend that add_figure_legend draws, in inches."""
    return LINE * (math.ceil(len(names) / _count_columns(names, columns)) + bool(note))


def add_figure_legend(
    figure: Figure, handles: Sequence[Any], *, names: Sequence[str], columns: int = 2, note: str = ""
) -> None:
    """Add samples and names below the figure, in up to ``columns`` columns, with ``note`` above them."""
    legend = figure.legend(
        list(handles),
        [shorten_figure_label(name, MAX_LEGEND_CHARACTERS) for name in names],
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
    widths = [
        _WIDTHS.get_text_width_height_descent(shorten_figure_label(n, MAX_LEGEND_CHARACTERS), font, False)[0]
        for n in names
    ]
    for columns in range(min(limit, len(names)), 1, -1):
        rows, extra = divmod(len(widths), columns)
        ends = [rows * c + min(c, extra) for c in range(columns + 1)]
        widest = [max(widths[a:b]) for a, b in pairwise(ends)]
        # The browser may use a font that is up to a tenth wider.
        if sum(1.1 * w + size * (HANDLE + GAP + 0.8) for w in widest) <= 72 * WIDTH:
            return columns
    return 1
