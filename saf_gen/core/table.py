"""Tables: columns that are defined once, and writers that take any table.

A row is any object. A column takes a value from it for programs, and makes a text of this value for readers.
``cli/_tables.py`` writes a table to the terminal, and ``leaderboard/report/`` as HTML.
"""

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from operator import attrgetter, itemgetter
from typing import Any, Literal

from saf_gen.core.plain_text import escape_latex, escape_markdown
from saf_gen.errors import escape_controls

UNKNOWN = "–"
TEXT_WIDTH = 80
"""Width of a terminal, in characters."""
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n")
"""Characters that begin a formula in a spreadsheet; a formula may read files and open addresses."""


@dataclass(frozen=True)
class Column:
    """A column: what it takes from a row, how it shows it, and what it means."""

    header: str
    value: str | Callable[[Any], Any]
    """Name of an attribute of the row, or a function that returns the value for a row; None is an unknown value."""
    format: str | Callable[[Any], str] = ""
    """Format of a known value, such as ``.2f``, or a function that returns its text."""
    meaning: str = ""
    cell: Callable[[Any], str] | None = None
    """Function that returns the text for a row, where it depends on more than the value."""
    key: str = ""
    """Name in files; by default the attribute or, for a function, the heading."""
    kind: Literal["text", "name", "note", "number", "main"] = "text"
    """How pages show the column; columns of numbers are sorted as numbers and aligned on the right."""
    detail: int = 0
    """Level of detail; if space is short, columns of the highest level are left out first, those of level 0 never."""
    group: str = ""
    """Common heading of adjacent columns, in writers that have two lines of headings."""
    together: str = ""
    """Columns with the same word here are shown or left out together."""
    folds: bool = False
    """Whether a terminal may break the texts into lines."""
    style: Callable[[Any], str] | None = None
    """Function that returns the style of the text for a row, on a terminal."""
    fraction: bool = False
    """Whether the value is a fraction of successes, 0 to 1, which a page draws as a bar."""
    ends: Callable[[Any], tuple[float | None, float | None]] | None = None
    """Function that returns the interval of the fraction."""
    link: str = ""
    """Address to which a page links the texts."""
    optional: bool = False
    """Whether readers see the column only if its value is known in at least one row."""
    for_programs: bool = False
    """Whether only programs see the column."""

    @property
    def name(self) -> str:
        """Name of the column in files."""
        return self.key or (self.value if isinstance(self.value, str) else self.header.replace(" ", "_"))

    @property
    def justify(self) -> Literal["left", "right"]:
        """Alignment of the texts."""
        return "right" if self.kind in ("number", "main") else "left"

    def get(self, row: Any) -> Any:
        """Return the value for a row, for programs; None if it is unknown."""
        return attrgetter(self.value)(row) if isinstance(self.value, str) else self.value(row)

    def text(self, row: Any) -> str:
        """Return the text for a row, for readers."""
        if self.cell is not None:
            return self.cell(row)
        value = self.get(row)
        if value is None:
            return UNKNOWN
        return format(value, self.format) if isinstance(self.format, str) else self.format(value)


@dataclass(frozen=True)
class Table:
    """Columns and rows, which every writer takes."""

    columns: Sequence[Column]
    rows: Sequence[Any]
    title: str = ""
    mark: Callable[[Any], str] = lambda row: ""
    """Function that returns the CSS class of a row on a page; '' for none."""

    @classmethod
    def of(cls, headers: Sequence[str], rows: Iterable[Sequence[Any]], *, title: str = "") -> "Table":
        """Return a table of rows of plain values, one for each heading."""
        return cls([Column(header, itemgetter(n)) for n, header in enumerate(headers)], list(rows), title)

    @cached_property
    def shown(self) -> list[Column]:
        """Columns for readers: without those for programs, and optional ones whose values are all unknown."""
        return [
            c
            for c in self.columns
            if not c.for_programs and (not c.optional or any(c.get(row) is not None for row in self.rows))
        ]

    @property
    def groups(self) -> list[tuple[str, int]]:
        """Common headings of the shown columns, each with the number of columns; empty if no column has one."""
        groups = [(group, len(list(columns))) for group, columns in groupby(self.shown, key=lambda c: c.group)]
        return groups if any(group for group, _ in groups) else []

    def up_to(self, detail: int) -> "Table":
        """Return the table without the columns above a level of detail."""
        return replace(self, columns=[c for c in self.columns if c.detail <= detail])

    def to_dicts(self) -> list[dict[str, Any]]:
        """Return the values of each row by the names of all columns."""
        return [{c.name: c.get(row) for c in self.columns} for row in self.rows]

    def to_csv(self) -> str:
        """Return all columns as CSV with one line of headings; unknown values become empty fields.

        An apostrophe is put before any text that a spreadsheet would run as a formula.
        """
        lines = [c.name for c in self.columns], *([c.get(row) for c in self.columns] for row in self.rows)
        return "".join(map(_format_csv_line, lines))

    def to_text(self, width: int = TEXT_WIDTH) -> str:
        """Return the shown columns that fit into a width, in characters, as a table of plain text."""
        texts = {c: [escape_controls(text) for text in (c.header, *map(c.text, self.rows))] for c in self.shown}
        widths = {c: max(map(len, cells)) for c, cells in texts.items()}
        shown = choose_columns(self.shown, fits=lambda some: sum(widths[c] + 3 for c in some) < width)
        cells = [[t.rjust(widths[c]) if c.justify == "right" else t.ljust(widths[c]) for t in texts[c]] for c in shown]
        head, *lines = (f"  {'   '.join(row)}".rstrip() for row in zip(*cells, strict=True))
        return "\n".join([head, " " + "─" * (sum(widths[c] + 3 for c in shown)), *lines])

    def to_markdown(self, *, explain: bool = False) -> str:
        """Return the shown columns as GitHub-flavoured Markdown; with ``explain``, meanings stand below headings."""
        shown = self.shown
        below = [f"<br>{escape_markdown(c.meaning)}" if explain and c.meaning else "" for c in shown]
        lines = [
            [_escape_heading(c.header) + meaning for c, meaning in zip(shown, below, strict=True)],
            ["---:" if c.justify == "right" else "---" for c in shown],
            *([escape_markdown(c.text(row)) for c in shown] for row in self.rows),
        ]
        return "".join(f"| {' | '.join(line)} |\n" for line in lines)

    def to_latex(self) -> str:
        """Return the shown columns as a LaTeX ``tabular`` that uses the rules of the package booktabs."""
        shown, headers, rules, first = self.shown, [], "", 1
        for group, span in self.groups:
            headers.append(rf"\multicolumn{{{span}}}{{c}}{{{escape_latex(group)}}}")
            rules += rf"\cmidrule(lr){{{first}-{first + span - 1}}}" if group else ""
            first += span
        body = ([c.header for c in shown], *([c.text(row) for c in shown] for row in self.rows))
        names, *lines = (" & ".join(map(escape_latex, cells)) + r" \\" for cells in body)
        return "\n".join(
            [
                r"% needs \usepackage{booktabs}",
                rf"\begin{{tabular}}{{{''.join(c.justify[0] for c in shown)}}}",
                r"\toprule",
                *([" & ".join(headers) + r" \\"] if headers else []),
                *([rules] if rules else []),
                names,
                r"\midrule",
                *lines,
                r"\bottomrule",
                r"\end{tabular}",
                "",
            ]
        )


def choose_columns(columns: Sequence[Column], *, fits: Callable[[Sequence[Column]], bool]) -> list[Column]:
    """Return the columns that fit, in order; once a column does not fit, those of a higher level are left out."""
    shown = [column for column in columns if column.detail == 0]
    for detail in sorted({column.detail for column in columns} - {0}):
        level = [column for column in columns if column.detail == detail]
        for group in dict.fromkeys(column.together or column.header for column in level):
            wider = [c for c in columns if c in shown or (c in level and (c.together or c.header) == group)]
            if fits(wider):
                shown = wider
        if not all(column in shown for column in level):
            break
    return shown


def percent(fraction: float) -> str:
    """Return a fraction as a percentage without decimals; halves are rounded up."""
    return f"{fraction + 1e-9:.0%}"  # 0.375 becomes 38 % even if rounding makes it slightly smaller


def _escape_heading(header: str) -> str:
    """Return the heading for Markdown; a blank at its end, which sets it apart from an equal heading, is kept."""
    return escape_markdown(header) + " " * header.endswith(" ")


def _format_csv_line(cells: Iterable[Any]) -> str:
    def safe(cell: Any) -> Any:
        if not isinstance(cell, str):
            return cell
        return "'" * cell.startswith(FORMULA_STARTS) + escape_controls(cell, keep="\t\r\n")

    line = io.StringIO()
    # It quotes a line break only if it ends its lines so.
    csv.writer(line, lineterminator="\r\n").writerow(map(safe, cells))
    return line.getvalue().removesuffix("\r\n") + "\n"
