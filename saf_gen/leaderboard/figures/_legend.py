"""The legend under a figure: as many columns as its names leave room for, and what the figure leaves out."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.legend_handler import HandlerTuple
from matplotlib.textpath import TextToPath

from saf_gen.leaderboard.figures._style import SOFT, STYLE, WIDTH, shorten_middle

__all__ = ["add_legend_below", "legend_height"]

LINE = 0.16  # inches
LETTERS = 52
"""Of a name; a longer one loses its middle."""
HANDLE, BETWEEN = 2.8, 1.2  # of the size of the letters: a sample, the gap between columns
_WIDTHS = TextToPath()


def legend_height(names: Sequence[str], *, columns: int = 2, note: str = "") -> float:
    """How high add_legend_below() will be."""
    return LINE * (math.ceil(len(names) / _columns(names, columns)) + bool(note))


def add_legend_below(
    figure: Figure, handles: Sequence[Any], names: Sequence[str], *, columns: int = 2, note: str = ""
) -> None:
    """Samples and names under the figure, ``columns`` beside each other where they are short enough.

    ``note`` stands over them: what the figure leaves out.
    """
    legend = figure.legend(
        list(handles),
        [shorten_middle(name, LETTERS) for name in names],
        handler_map={tuple: HandlerTuple(ndivide=1, pad=0)},
        loc="outside lower center",
        ncols=_columns(names, columns),
        handlelength=HANDLE,
        columnspacing=BETWEEN,
        labelspacing=0.35,
        title=note or None,
        title_fontsize=STYLE["legend.fontsize"],
        alignment="left",
    )
    legend.get_title().set_color(SOFT)


def _columns(names: Sequence[str], most: int) -> int:
    """The most columns that fit: matplotlib fills one after the other, each as wide as its widest name."""
    size = STYLE["legend.fontsize"]
    font = FontProperties(family=STYLE["font.family"], size=size)
    wide = [_WIDTHS.get_text_width_height_descent(shorten_middle(n, LETTERS), font, False)[0] for n in names]
    for columns in range(min(most, len(names)), 1, -1):
        high, more = divmod(len(wide), columns)
        ends = [high * c + min(c, more) for c in range(columns + 1)]
        widest = [max(wide[a:b]) for a, b in pairwise(ends)]
        # Pages have letters of their own, up to a tenth wider.
        if sum(1.1 * w + size * (HANDLE + BETWEEN + 0.8) for w in widest) <= 72 * WIDTH:
            return columns
    return 1
