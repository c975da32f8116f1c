"""Tables of `saf-gen bench`: figures with their targets, and the grain of each scene."""

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from saf_gen.cli._tables import TableColumn, print_table
from saf_gen.cli._terminal import out

if TYPE_CHECKING:
    from saf_gen.acceptance.speed import BenchFigure

MARKS = {True: "yes", False: "no", None: ""}


def print_figures(figures: "Iterable[BenchFigure]") -> None:
    """Print a table with a row for each figure."""
    columns = [TableColumn("bench"), *(TableColumn(name, folds=True) for name in ("what", "measured", "unit"))]
    print_table(
        [*columns, TableColumn("target"), TableColumn("met")],
        [(f.bench, f.what, _with_interval(f), f.unit, _target(f), MARKS[f.met]) for f in figures],
    )


def print_scene_grain(scene: str, figures: "Iterable[BenchFigure]") -> None:
    """Print the grain of a scene as a table with a row per position, and a line for each figure without a cell."""
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
    for position in dict.fromkeys(row for row, _ in cells):
        found = [cells.get((position, column)) for column in columns]
        rows.append((position, *("" if f is None else _format_cell(f) for f in found)))
    print_table(
        [TableColumn("picture"), *(TableColumn(name, folds=True, drop_order=1, justify="right") for name in columns)],
        rows,
        title=f"{scene}: grain in %, with the interval below each figure",
        where_to_find="--json prints them",
    )
    missed = sorted({f"{f.target:g} % in {column}" for (_, column), f in cells.items() if f.met is False})
    if missed:
        out.print(f"! marks figures above their target: {', '.join(missed)}")
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
    """Return a figure, with its interval on the next line, in lines of at most eleven characters."""
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
    """Return a figure in at most five characters: two digits below 1, three above, or <0.01 or >1e5."""
    if not math.isfinite(value):
        return "–" if math.isnan(value) else "∞"
    if value < 0.01:
        return "<0.01"
    if value < 1:
        return f"{value:.2g}"
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}" if value < 1e5 else ">1e5"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"
