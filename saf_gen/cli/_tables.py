"""Tables that fit the terminal: prose is folded, then columns are left out, but names and figures are never cut."""

import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rich import box
from rich.cells import cell_len
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from saf_gen.cli._terminal import out
from saf_gen.errors import escape_controls

PROSE_WIDTH = 22
"""Least width of a folded column in characters, unless all its texts are shorter."""


@dataclass(frozen=True)
class TableColumn:
    """A column of a table.

    Parameters
    ----------
    header : str
        Heading. Its key in JSON has _ instead of blanks.
    folds : bool, default False
        Whether texts may be broken into lines.
    drop_order : int, default 0
        Order in which columns are left out if the table is too wide: the highest number first, 0 never. Among columns
        with the same number, those that fit are shown.
    group : str, optional
        Columns of the same group are shown or left out together.
    justify : {"left", "right"}, default "left"
        Alignment of the texts.
    """

    header: str
    folds: bool = False
    drop_order: int = 0
    group: str = ""
    justify: Literal["left", "right"] = "left"


def print_table(
    columns: Sequence[TableColumn],
    rows: Iterable[Sequence[str | Text]],
    *,
    title: str = "",
    where_to_find: str = "",
    as_json: bool = False,
) -> None:
    """Print a table: at full width to a pipe or file, or fitted to the width of the terminal.

    Parameters
    ----------
    columns : sequence of TableColumn
        All columns.
    rows : iterable of sequence of str or Text
        Texts of each row, one per column.
    title : str, optional
        Text above the table.
    where_to_find : str, optional
        Clause that says where to find the columns that were left out.
    as_json : bool, default False
        Print :func:`to_objects` as JSON instead.
    """
    if as_json:
        print_json(to_objects(columns, rows))
        return
    cells = [[escape_controls(cell, keep="\n") if isinstance(cell, str) else cell for cell in row] for row in rows]

    def measure(shown: Sequence[TableColumn]) -> Measurement:
        table = _build(columns, shown, cells=cells, title=title)
        return Measurement.get(out, out.options.update(max_width=100_000), table)

    shown = list(columns)
    if not out.is_terminal:
        out.width = max(out.width, measure(shown).maximum)
    elif measure(shown).minimum > out.width:
        shown = _choose_columns(columns, fits=lambda some: measure(some).minimum <= out.width)
    fold_all = out.is_terminal and measure(shown).minimum > out.width
    out.print(_build(columns, shown, cells=cells, title=title, fold_all=fold_all))
    left_out = [column.header for column in columns if column not in shown]
    if left_out:
        out.print(
            f"Columns that do not fit here: {', '.join(left_out)}{f' ({where_to_find})' if where_to_find else ''}"
        )


def _choose_columns(
    columns: Sequence[TableColumn], *, fits: Callable[[Sequence[TableColumn]], bool]
) -> list[TableColumn]:
    """Return the columns that fit, in order; once a column does not fit, those of larger ``drop_order`` are dropped."""
    shown = [column for column in columns if column.drop_order == 0]
    for order in sorted({column.drop_order for column in columns} - {0}):
        level = [column for column in columns if column.drop_order == order]
        groups = dict.fromkeys(column.group or column.header for column in level)
        for group in groups:
            wider = [c for c in columns if c in shown or (c in level and (c.group or c.header) == group)]
            if fits(wider):
                shown = wider
        if not all(column in shown for column in level):
            break
    return shown


def to_objects(columns: Sequence[TableColumn], rows: Iterable[Sequence[str | Text]]) -> list[dict[str, str]] | dict:
    """Return a table for JSON: an object per row, whose keys are the headings with _ instead of blanks.

    A table of two columns without headings becomes a single object of keys and values.
    """
    keys = [column.header.replace(" ", "_") for column in columns]
    texts = [[str(cell) for cell in row] for row in rows]
    return [dict(zip(keys, row, strict=True)) for row in texts] if any(keys) else dict(texts)


def finite_value(value: float) -> float | None:
    """Return a value for JSON, with None for infinite values and NaN."""
    return value if math.isfinite(value) else None


def print_json(document: Any, path: Path | None = None) -> None:
    """Print a document as indented JSON, or write it to a file."""
    text = escape_controls(json.dumps(document, indent=1, ensure_ascii=False) + "\n", keep="\n", write=json.dumps)
    if path is None:
        out.file.write(text)
    else:
        path.write_text(text, encoding="utf-8")


def _build(
    columns: Sequence[TableColumn],
    shown: Sequence[TableColumn],
    *,
    cells: Sequence[Sequence[str | Text]],
    title: str,
    fold_all: bool = False,
) -> Table:
    named = any(column.header for column in columns)
    table = Table(title=title or None, title_justify="left", box=box.SIMPLE_HEAD if named else None, show_header=named)
    indices = [i for i, column in enumerate(columns) if column in shown]
    for i in indices:
        column = columns[i]
        texts = [column.header, *(str(row[i]) for row in cells)]
        folds = column.folds or fold_all
        table.add_column(
            column.header,
            justify=column.justify,
            no_wrap=not folds,
            overflow="fold",
            min_width=None if fold_all else _min_width(texts, folds=folds),
        )
    for row in cells:
        table.add_row(*(row[i] for i in indices))
    return table


def _min_width(texts: Sequence[str], *, folds: bool) -> int:
    """Return the least width of a column in characters.

    This is the length of its longest line; a column that folds may be as narrow as PROSE_WIDTH or its longest word.
    """
    longest = max(cell_len(line) for text in texts for line in text.splitlines() or [""])
    words = (word for text in texts for word in text.split())
    return max(min(PROSE_WIDTH, longest), *map(cell_len, words), 0) if folds else longest
