"""Figure of the errors of each method in one scene."""

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
from saf_gen.core.figure_style import BAND, GREY, INK, PAPER, SOFT, assign_styles, hide_spines, use_plot_style
from saf_gen.leaderboard.figures._figure import (
    MAX_LABEL_CHARACTERS,
    create_leaderboard_figure,
    describe_figure_omissions,
    shorten_figure_label,
)
from saf_gen.leaderboard.figures._legend import add_figure_legend, figure_legend_height

NO_LIGHT = "recording"
MANY_ROWS, MAX_ROWS = 30, 80
"""Numbers of methods above which rows are drawn closer together, and above which further methods are left out."""
ROW, CLOSE_ROW = 0.2, 0.14  # inches
MAX_MARKS = 600
"""Largest number of answers in a scene for which every answer has its own mark."""


def plot_error_figure(records: Sequence[Record], *, title: str) -> Figure:
    """Return the figure of the errors in one scene: one row per method, in the order of ``records``.

    Each answer has a mark in the style of its light schedule. If there are more than MAX_MARKS answers, a mark is the
    median of the answers of a method under one light, and a line covers the middle 90 %. At most the first
    MAX_ROWS methods are drawn. A note in the figure says if either limit applies.
    """
    all_methods = list(dict.fromkeys(r.method for r in records))
    methods = all_methods[:MAX_ROWS]
    records = [r for r in records if r.method in methods]
    note = describe_figure_omissions((len(methods), len(all_methods), "methods"))
    many = len(records) > MAX_MARKS
    if many:
        note = "; ".join([*([note] if note else []), "marks are medians, lines the middle 90 %"])
    row_inches = ROW if len(methods) <= MANY_ROWS else CLOSE_ROW
    lights = assign_styles([r.light or NO_LIGHT for r in records])
    known = [abs(r.error_dof) for r in records if r.error_dof is not None]
    reach = max([3.0, *known]) * 1.3
    size = 4.5 if len(methods) <= MANY_ROWS else 3.6
    marks: list[Any] = [style.legend_handle(ls="") for style in lights.values()]
    marks += [Patch(color=BAND, alpha=0.3), Line2D([], [], ls="", marker="x", color=SOFT, mew=1.3)]
    names = [*lights, "success: within 1", "no answer"]
    with use_plot_style():
        below = figure_legend_height(names, columns=3, note=note)
        figure = create_leaderboard_figure(row_inches * len(methods) + 0.95 + below, title=title)
        axes = figure.subplots()
        axes.axvspan(-1, 1, color=BAND, alpha=0.3, lw=0)
        axes.axvline(0, color=INK, lw=1.1)
        for row in range(len(methods)):
            axes.axhline(row, color=GREY, lw=0.6, zorder=0)
        for number, (light, style) in enumerate(lights.items()):
            group = [r for r in records if (r.light or NO_LIGHT) == light]
            offset = (number - (len(lights) - 1) / 2) * 0.66 / max(len(lights), 3)
            answered = [(r.error_dof, methods.index(r.method) + offset) for r in group if r.error_dof is not None]
            silent = [(reach, methods.index(r.method) + offset) for r in group if r.status != "answered"]
            if many:
                silent = sorted(set(silent))
                answered = _draw_spread(axes, answered, colour=style.colour)
            for points, marker, more in ((answered, style.marker, {"mec": PAPER}), (silent, "x", {"mew": 1.3})):
                if points:
                    xy = np.array(points, dtype=np.float64).T
                    options: dict[str, Any] = {"ms": size, "mew": 0.5, "ls": "", "clip_on": False, **more}
                    axes.plot(*xy, marker=marker, color=style.colour, **options)
        _set_signed_error_axis(axes, reach)
        axes.set_yticks(range(len(methods)), [shorten_figure_label(m, MAX_LABEL_CHARACTERS) for m in methods])
        axes.set_ylim(len(methods) - 0.4, -0.6)
        axes.tick_params(axis="y", length=0, labelsize=7.5)
        hide_spines(axes, "left", "right", "top")
        add_figure_legend(figure, marks, names=names, columns=3, note=note)
    return figure


def _draw_spread(axes: Axes, points: Sequence[tuple[float, float]], *, colour: str) -> list[tuple[float, float]]:
    """Draw a line over the middle 90 % of the errors at each height, and return the medians at these heights."""
    by_height: dict[float, list[float]] = {}
    for error, height in points:
        by_height.setdefault(height, []).append(error)
    medians = []
    for height, errors in by_height.items():
        low, median, high = np.quantile(errors, [0.05, 0.5, 0.95])
        axes.plot([low, high], [height, height], color=colour, lw=1.1, solid_capstyle="butt")
        medians.append((float(median), height))
    return medians


def _set_signed_error_axis(axes: Axes, reach: float) -> None:
    axes.set_xscale("symlog", linthresh=1, linscale=0.8)
    axes.set_xlim(-reach, reach)
    powers = 10.0 ** np.arange(0, int(math.log10(reach)) + 1)
    axes.xaxis.set_major_locator(FixedLocator([*-powers[::-1], 0, *powers]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:+g}".replace("-", "−") if x else "0"))
    axes.set_xlabel("answer − truth, depths of focus")
