"""What `saf-gen bench` prints: a table of figures with their targets, and one of the grain of each scene."""

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from saf_gen.cli._tables import TableColumn, print_table
from saf_gen.cli._terminal import out

if TYPE_CHECKING:
    from saf_gen.acceptance.speed import BenchFigure

MARKS = {True: "yes", False: "no", None: ""}


def print_figures(figures: "Iterable[BenchFigure]") -> None:
    """Print a table of figures, a line each."""
    columns = [TableColumn("bench"), *(TableColumn(name, folds=True) for name in ("what", "measured", "unit"))]
    print_table(
        [*columns, TableColumn("target"), TableColumn("met")],
        [(f.bench, f.what, _with_interval(f), f.unit, _target(f), MARKS[f.met]) for f in figures],
    )


def print_scene_grain(scene: str, figures: "Iterable[BenchFigure]") -> None:
    """Print the grain of a scene as a table of a row per place, and a line for each figure that has no cell in it."""
    cells: dict[tuple[str, str], BenchFigure] = {}
    lines = []
    for f in figures:
        if f.cell is not None:
            cells[f.cell] = f
        else:
            target = f", target {_target(f)}" if _target(f) else ""
            lines.append(f"{f.what}: {_with_interval(f)} {f.unit}{target}")
    columns = list(dict.fromkeys(column for _, column in cells))
    rows = []
    for place in dict.fromkeys(row for row, _ in cells):
        found = [cells.get((place, column)) for column in columns]
        rows.append((place, *("" if f is None else _format_cell(f) for f in found)))
    print_table(
        [TableColumn("place"), *(TableColumn(name, folds=True, detail=1, justify="right") for name in columns)],
        rows,
        title=f"{scene}: grain in %, each figure above its interval",
        elsewhere="--json has them",
    )
    missed = sorted({f"{f.target:g} % in {column}" for (_, column), f in cells.items() if f.met is False})
    if missed:
        out.print(f"! is above its goal: {', '.join(missed)}")
    for line in lines:
        out.print(line)


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
