"""Tables that fit the terminal: prose is folded, then columns are left out, and no name and no figure is ever cut."""

import json
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
"""Characters that a line of a folded column has at least, where its texts are as long."""


@dataclass(frozen=True)
class TableColumn:
    """One column: its heading, whether its texts may be folded, and how soon it is left out where there is no room.

    ``detail`` 0 is never left out; of the others the highest goes first, and what is level with one that has no room
    stays where there is room. Columns with the same ``together`` are shown or left out together.
    """

    header: str
    folds: bool = False
    detail: int = 0
    together: str = ""
    justify: Literal["left", "right"] = "left"


def print_table(
    columns: Sequence[TableColumn],
    rows: Iterable[Sequence[str | Text]],
    *,
    title: str = "",
    elsewhere: str = "",
    as_json: bool = False,
) -> None:
    """Print a table as wide as it is into a pipe or file, and to a terminal so that it fits.

    ``elsewhere`` says where the columns stand that had to be left out. ``as_json`` prints
    :func:`list_objects_to_print` instead.
    """
    if as_json:
        print_json(list_objects_to_print(columns, rows))
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
        out.print(f"No room here for: {', '.join(left_out)}{f' ({elsewhere})' if elsewhere else ''}")


def _choose_columns(
    columns: Sequence[TableColumn], *, fits: Callable[[Sequence[TableColumn]], bool]
) -> list[TableColumn]:
    """Return the columns that there is room for, detail by detail, up to the first one that does not fit whole."""
    shown = [column for column in columns if column.detail == 0]
    for detail in sorted({column.detail for column in columns} - {0}):
        level = [column for column in columns if column.detail == detail]
        groups = dict.fromkeys(column.together or column.header for column in level)
        for group in groups:
            wider = [c for c in columns if c in shown or (c in level and (c.together or c.header) == group)]
            if fits(wider):
                shown = wider
        if not all(column in shown for column in level):
            break
    return shown


def list_objects_to_print(
    columns: Sequence[TableColumn], rows: Iterable[Sequence[str | Text]]
) -> list[dict[str, str]] | dict:
    """Return a table for JSON: an object per row, its keys the headings with _ for blanks.

    Two columns without headings are one object.
    """
    keys = [column.header.replace(" ", "_") for column in columns]
    texts = [[str(cell) for cell in row] for row in rows]
    return [dict(zip(keys, row, strict=True)) for row in texts] if any(keys) else dict(texts)


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
    places = [i for i, column in enumerate(columns) if column in shown]
    for i in places:
        column = columns[i]
        texts = [column.header, *(str(row[i]) for row in cells)]
        folds = column.folds or fold_all
        table.add_column(
            column.header,
            justify=column.justify,
            no_wrap=not folds,
            overflow="fold",
            min_width=None if fold_all else _least_width(texts, folds=folds),
        )
    for row in cells:
        table.add_row(*(row[i] for i in places))
    return table


def _least_width(texts: Sequence[str], *, folds: bool) -> int:
    """Return the characters that a column must have: its longest word, where texts are folded, or its longest text."""
    longest = max(cell_len(line) for text in texts for line in text.splitlines() or [""])
    words = (word for text in texts for word in text.split())
    return max(min(PROSE_WIDTH, longest), *map(cell_len, words), 0) if folds else longest
