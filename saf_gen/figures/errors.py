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

from saf_gen.figures._style import BAND, GREY, INK, PAPER, SOFT, bare, drawing, looks, new_figure
from saf_gen.records import Record

__all__ = ["errors_figure"]

NO_LIGHT = "recording"


def errors_figure(records: Sequence[Record], *, title: str) -> Figure:
    """Errors of one scene: a row for each method in the order given, a mark for each light schedule."""
    methods = list(dict.fromkeys(r.method for r in records))
    lights = looks([r.light or NO_LIGHT for r in records])
    known = [abs(r.error_dof) for r in records if r.error_dof is not None]
    reach = max([3.0, *known]) * 1.3
    with drawing():
        figure = new_figure(0.2 * len(methods) + 0.95 + 0.16 * math.ceil((len(lights) + 2) / 3), title=title)
        axes = figure.subplots()
        axes.axvspan(-1, 1, color=BAND, alpha=0.3, lw=0)
        axes.axvline(0, color=INK, lw=1.1)
        for row in range(len(methods)):
            axes.axhline(row, color=GREY, lw=0.6, zorder=0)
        for number, (light, look) in enumerate(lights.items()):
            mine = [r for r in records if (r.light or NO_LIGHT) == light]
            offset = (number - (len(lights) - 1) / 2) * 0.66 / max(len(lights), 3)
            answered = [
                (r.error_dof, methods.index(r.method) + offset) for r in mine if r.error_dof is not None
            ]
            silent = [(reach, methods.index(r.method) + offset) for r in mine if r.status != "answered"]
            for points, marker, more in (
                (answered, look.marker, {"mec": PAPER}),
                (silent, "x", {"mew": 1.3}),
            ):
                if points:
                    at = np.array(points, dtype=np.float64).T
                    options: dict[str, Any] = {"ms": 4.5, "mew": 0.5, "ls": "", "clip_on": False, **more}
                    axes.plot(*at, marker=marker, color=look.colour, **options)
        _signed_dof(axes, reach)
        axes.set_yticks(range(len(methods)), methods)
        axes.set_ylim(len(methods) - 0.4, -0.6)
        axes.tick_params(axis="y", length=0, labelsize=7.5)
        bare(axes, "left", "right", "top")
        marks: list[Any] = [look.line(ls="") for look in lights.values()]
        marks += [Patch(color=BAND, alpha=0.3), Line2D([], [], ls="", marker="x", color=SOFT, mew=1.3)]
        figure.legend(marks, [*lights, "success: within 1", "no answer"], loc="outside lower center", ncols=3)
    return figure


def _signed_dof(axes: Axes, reach: float) -> None:
    axes.set_xscale("symlog", linthresh=1, linscale=0.8)
    axes.set_xlim(-reach, reach)
    powers = 10.0 ** np.arange(0, math.floor(math.log10(reach)) + 1)
    axes.xaxis.set_major_locator(FixedLocator([*-powers[::-1], 0, *powers]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:+g}".replace("-", "−") if x else "0"))
    axes.set_xlabel("answer − truth, depths of focus")
