"""What `saf-gen bench` prints: a table of figures with their targets, and one of the grain of each scene."""

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from rich import box
from rich.table import Table

if TYPE_CHECKING:
    from saf_gen.acceptance.speed import BenchFigure

WIDTH = 100
"""Columns that tables have room in."""


def make_figure_table(figures: "Iterable[BenchFigure]") -> Table:
    """Return a table of figures, a line each."""
    table = Table("bench", "what", "measured", "unit", "target", "met")
    marks = {True: "yes", False: "no", None: ""}
    for f in figures:
        table.add_row(f.bench, f.what, _with_interval(f), f.unit, _target(f), marks[f.met])
    return table


def make_scene_table(scene: str, figures: "Iterable[BenchFigure]") -> tuple[Table, list[str]]:
    """Return the grain of a scene as a table of a row per place, and a line for each figure that has no cell in it."""
    cells: dict[tuple[str, str], BenchFigure] = {}
    lines = []
    for f in figures:
        if f.cell is not None:
            cells[f.cell] = f
        else:
            target = f", target {_target(f)}" if _target(f) else ""
            lines.append(f"{f.what}: {_with_interval(f)} {f.unit}{target}")
    columns = list(dict.fromkeys(column for _, column in cells))
    missed = sorted({f"{f.target:g} % in {column}" for (_, column), f in cells.items() if f.met is False})
    caption = f"! is above its goal: {', '.join(missed)}" if missed else None
    title = f"{scene}: grain in %, each figure above its interval"
    table = Table("", title=title, caption=caption, box=box.SIMPLE_HEAD, width=WIDTH)
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    for row in dict.fromkeys(row for row, _ in cells):
        found = [cells.get((row, column)) for column in columns]
        table.add_row(row, *("" if f is None else _format_cell(f) for f in found))
    return table, lines


def _target(figure: "BenchFigure") -> str:
    return "" if figure.target is None else f"{'≤' if figure.at_most else '≥'} {figure.target:g}"


def _with_interval(figure: "BenchFigure") -> str:
    value = _number(figure.value)
    if figure.low is None or figure.high is None:
        return value
    return f"{value} ({_number(figure.low)} to {_number(figure.high)})"


def _format_cell(figure: "BenchFigure") -> str:
    """Return a figure above its interval, in at most eleven columns."""
    value = _short(figure.value)
    if figure.met is False:
        value = f"! {value}"
    if figure.low is None or figure.high is None or math.isnan(figure.value):
        return value
    low, high = _short(figure.low), _short(figure.high)
    if math.isinf(figure.high):
        return f"{value}\n≥ {low}" if figure.low > 0 else f"{value}\nunknown"
    return f"{value}\n{low}–{high}" if low != high else value


def _short(value: float) -> str:
    """Return a figure in at most five columns: two digits below 1, three above, and what is tiny as that."""
    if not math.isfinite(value):
        return "–" if math.isnan(value) else "∞"
    if value < 0.01:
        return "<0.01"
    if value < 1:
        return f"{value:.2g}"
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}" if value < 1e5 else ">1e5"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"
