"""How far each method's answers lie from the truth, in one scene."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter

from saf_gen.benchmark.records import Record
from saf_gen.leaderboard.figures._legend import add_legend_below, legend_height
from saf_gen.leaderboard.figures._style import (
    BAND,
    GREY,
    INK,
    PAPER,
    SOFT,
    assign_styles,
    create_figure,
    describe_omissions,
    hide_spines,
    shorten_middle,
    use_figure_style,
)

__all__ = ["plot_errors"]

NO_LIGHT = "recording"
MANY, MOST_ROWS = 30, 80
"""Methods from which rows lie closer, and beyond which they are left out."""
ROW, CLOSE_ROW = 0.2, 0.14  # inches
LETTERS = 34
"""Of a method's name."""


def plot_errors(records: Sequence[Record], *, title: str) -> Figure:
    """Errors of one scene: a row for each method in the order given, a mark for each light schedule.

    Of very many methods the first MOST_ROWS, and the figure says so.
    """
    every = list(dict.fromkeys(r.method for r in records))
    methods = every[:MOST_ROWS]
    records = [r for r in records if r.method in methods]
    note = describe_omissions((len(methods), len(every), "methods"))
    row_inches = ROW if len(methods) <= MANY else CLOSE_ROW
    lights = assign_styles([r.light or NO_LIGHT for r in records])
    known = [abs(r.error_dof) for r in records if r.error_dof is not None]
    reach = max([3.0, *known]) * 1.3
    size = 4.5 if len(methods) <= MANY else 3.6
    marks: list[Any] = [style.legend_handle(ls="") for style in lights.values()]
    marks += [Patch(color=BAND, alpha=0.3), Line2D([], [], ls="", marker="x", color=SOFT, mew=1.3)]
    names = [*lights, "success: within 1", "no answer"]
    with use_figure_style():
        below = legend_height(names, columns=3, note=note)
        figure = create_figure(row_inches * len(methods) + 0.95 + below, title=title)
        axes = figure.subplots()
        axes.axvspan(-1, 1, color=BAND, alpha=0.3, lw=0)
        axes.axvline(0, color=INK, lw=1.1)
        for row in range(len(methods)):
            axes.axhline(row, color=GREY, lw=0.6, zorder=0)
        for number, (light, style) in enumerate(lights.items()):
            mine = [r for r in records if (r.light or NO_LIGHT) == light]
            offset = (number - (len(lights) - 1) / 2) * 0.66 / max(len(lights), 3)
            answered = [
                (r.error_dof, methods.index(r.method) + offset) for r in mine if r.error_dof is not None
            ]
            silent = [(reach, methods.index(r.method) + offset) for r in mine if r.status != "answered"]
            for points, marker, more in (
                (answered, style.marker, {"mec": PAPER}),
                (silent, "x", {"mew": 1.3}),
            ):
                if points:
                    at = np.array(points, dtype=np.float64).T
                    options: dict[str, Any] = {"ms": size, "mew": 0.5, "ls": "", "clip_on": False, **more}
                    axes.plot(*at, marker=marker, color=style.colour, **options)
        _signed_dof(axes, reach)
        axes.set_yticks(range(len(methods)), [shorten_middle(m, LETTERS) for m in methods])
        axes.set_ylim(len(methods) - 0.4, -0.6)
        axes.tick_params(axis="y", length=0, labelsize=7.5)
        hide_spines(axes, "left", "right", "top")
        add_legend_below(figure, marks, names, columns=3, note=note)
    return figure


def _signed_dof(axes: Axes, reach: float) -> None:
    axes.set_xscale("symlog", linthresh=1, linscale=0.8)
    axes.set_xlim(-reach, reach)
    powers = 10.0 ** np.arange(0, math.floor(math.log10(reach)) + 1)
    axes.xaxis.set_major_locator(FixedLocator([*-powers[::-1], 0, *powers]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:+g}".replace("-", "−") if x else "0"))
    axes.set_xlabel("answer − truth, depths of focus")
