"""Tables that fit the width: prose is folded, then columns are left out, but names and figures are never cut."""

import json
from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rich.table
from rich import box
from rich.cells import cell_len
from rich.measure import Measurement
from rich.text import Text

from saf_gen.cli._terminal import out
from saf_gen.core.files import write_text
from saf_gen.core.table import Column, Table, choose_columns
from saf_gen.errors import escape_controls

if TYPE_CHECKING:
    from saf_gen.leaderboard.report import WrittenEvaluation

PROSE_WIDTH = 22
"""Least width of a folded column in characters, unless all its texts are shorter."""


def print_table(table: Table, *, where_to_find: str | None = "", as_json: bool = False) -> None:
    """Print a table that fits the terminal or, to a pipe or file, the columns that COLUMNS states, or 120.

    Parameters
    ----------
    table : Table
        The table.
    where_to_find : str, optional
        Clause that says where to find the columns that were left out; if None, they are not named.
    as_json : bool, default False
        Whether to print :func:`to_objects` as JSON instead.
    """
    if as_json:
        print_json(to_objects(table))
        return
    columns = table.shown
    cells = {column: [_cell(column, row) for row in table.rows] for column in columns}

    def build(shown: Sequence[Column], *, fold_all: bool = False) -> rich.table.Table:
        return _build({column: cells[column] for column in shown}, title=table.title, fold_all=fold_all)

    def measure(shown: Sequence[Column]) -> Measurement:
        return Measurement.get(out, out.options.update(max_width=100_000), build(shown))

    shown = columns
    if measure(shown).minimum > out.width:
        shown = choose_columns(columns, fits=lambda some: measure(some).minimum <= out.width)
    out.print(build(shown, fold_all=measure(shown).minimum > out.width))
    left_out = [column.header for column in columns if column not in shown]
    if left_out and where_to_find is not None:
        found = f" ({where_to_find})" if where_to_find else ""
        out.print(f"Columns that do not fit here: {', '.join(left_out)}{found}")


def print_facts(facts: Mapping[str, str], *, title: str = "") -> None:
    """Print names and texts as a table without headings."""
    print_table(Table([Column("", itemgetter(0)), Column("", itemgetter(1), folds=True)], list(facts.items()), title))


def print_leaderboard(
    table: Table, *, last_words: Iterable[str] = (), written: "WrittenEvaluation | None" = None
) -> None:
    """Print the columns of a leaderboard that fit, what follows from it, and where its page is."""
    print_table(table, where_to_find=None)
    for line in last_words:
        out.print(line)
    if written is not None:
        for line in filter(None, (written.replaced, f"All columns, conditions and names: open {written.page}")):
            out.print(escape_controls(line), soft_wrap=True)


def to_objects(table: Table) -> list[dict[str, str]]:
    """Return the texts of each row for JSON, by the headings with _ instead of blanks."""
    return [{c.header.replace(" ", "_"): c.text(row) for c in table.shown} for row in table.rows]


def print_json(document: Any, path: Path | None = None) -> None:
    """Print a document as indented JSON, or write it to a file."""
    text = escape_controls(json.dumps(document, indent=1, ensure_ascii=False) + "\n", keep="\n", write=json.dumps)
    if path is None:
        out.file.write(text)
    else:
        write_text(path, text)


def _cell(column: Column, row: Any) -> str | Text:
    text = escape_controls(column.text(row), keep="\n")
    return Text(text, column.style(row)) if column.style else text


def _build(cells: Mapping[Column, Sequence[str | Text]], *, title: str, fold_all: bool) -> rich.table.Table:
    named = any(column.header for column in cells)
    table = rich.table.Table(
        title=title or None, title_justify="left", box=box.SIMPLE_HEAD if named else None, show_header=named
    )
    for column, texts in cells.items():
        folds = column.folds or fold_all
        table.add_column(
            column.header,
            justify=column.justify,
            no_wrap=not folds,
            overflow="fold",
            min_width=None if fold_all else _min_width([column.header, *map(str, texts)], folds=folds),
        )
    for row in zip(*cells.values(), strict=True):
        table.add_row(*row)
    return table


def _min_width(texts: Sequence[str], *, folds: bool) -> int:
    """Return the least width of a column in characters.

    This is the length of its longest line; a column that folds may be as narrow as PROSE_WIDTH or its longest word.
    """
    longest = max(cell_len(line) for text in texts for line in text.splitlines() or [""])
    words = (word for text in texts for word in text.split())
    return max(min(PROSE_WIDTH, longest), *map(cell_len, words), 0) if folds else longest
