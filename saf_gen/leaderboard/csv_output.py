"""CSV text for programs that is also safe to open in a spreadsheet."""

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any

FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n")
"""Characters that begin a formula in a spreadsheet; a formula may read files and open addresses."""


def format_leaderboard_csv(header: Sequence[str], lines: Iterable[Sequence[Any]]) -> str:
    """Return CSV text with one header line; None becomes an empty field.

    An apostrophe is put before any text that a spreadsheet would run as a formula.
    """
    sheet = io.StringIO()
    quoted = ([f"'{cell}" if isinstance(cell, str) and cell.startswith(FORMULA_STARTS) else cell for cell in line]
              for line in (header, *lines))  # fmt: skip
    csv.writer(sheet, lineterminator="\n").writerows(quoted)
    return sheet.getvalue()
