"""Style and axes of the figures of studies/, in the colours of Okabe and Ito."""

import math
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

__all__ = ["BLUE", "GREEN", "GREY", "ORANGE", "log_log", "panels", "save", "slope", "wide"]

BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#6b7280"
STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.linewidth": 0.8,
    "axes.edgecolor": GREY,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#e2e5e9",
    "legend.frameon": False,
}


def panels(rows: int, columns: int, *, width: float, height: float) -> tuple[Figure, np.ndarray]:
    """Return a figure with a size in inches, and its panels (rows, columns)."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        return figure, figure.subplots(rows, columns, squeeze=False)


def log_log(axes: Axes, x: list[float], *, y: list[float], colour: str, label: str = "") -> None:
    """Plot a line with its points on logarithmic axes, with ticks at decades, or at 1, 2 and 5 of each."""
    axes.loglog(x, y, "o-", color=colour, markersize=4, linewidth=1.5, label=label)
    for axis, values in ((axes.xaxis, x), (axes.yaxis, y)):
        marks = (1,) if max(values) > 50 * min(values) else (1, 2, 5)
        axis.set_major_locator(LogLocator(subs=marks, numticks=7))
        axis.set_major_formatter(FuncFormatter(_short))
        axis.set_minor_locator(NullLocator())
    axes.grid(True, which="major")
    axes.set_axisbelow(True)


def _short(value: float, _: object) -> str:
    for unit, sign in ((1e6, "M"), (1e3, "k")):
        if value >= unit:
            return f"{value / unit:g}{sign}"
    return f"{value:g}"


def wide(axes: Axes, y: list[float]) -> None:
    """Show at least a decade, so that a curve that grows little looks flat."""
    middle, half = math.sqrt(min(y) * max(y)), math.sqrt(max(10.0, 2 * max(y) / min(y)))
    axes.set_ylim(middle / half, middle * half)


def slope(x: list[float], y: list[float]) -> float:
    """Return the exponent n of y ~ x**n, by least squares over the last three points."""
    return float(np.polyfit(np.log(x[-3:]), np.log(y[-3:]), 1)[0])


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, and create its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with matplotlib.rc_context(STYLE):
        FigureCanvasAgg(figure)
        figure.savefig(path, dpi=150)
