"""CSV files for programs, which spreadsheets open too."""

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any

FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n")
"""What a spreadsheet takes for the beginning of a formula, which may read files and call addresses."""


def format_leaderboard_csv(header: Sequence[str], lines: Iterable[Sequence[Any]]) -> str:
    """Return a CSV text with one header line; None becomes an empty field.

    A text that a spreadsheet would run gets an apostrophe before it.
    """
    sheet = io.StringIO()
    quoted = ([f"'{cell}" if isinstance(cell, str) and cell.startswith(FORMULA_STARTS) else cell for cell in line]
              for line in (header, *lines))  # fmt: skip
    csv.writer(sheet, lineterminator="\n").writerows(quoted)
    return sheet.getvalue()
