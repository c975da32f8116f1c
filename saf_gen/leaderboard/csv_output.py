"""Tables for programs."""

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any

__all__ = ["format_csv"]


def format_csv(heads: Sequence[str], lines: Iterable[Sequence[Any]]) -> str:
    """A CSV with one line of headings; None is an empty field."""
    sheet = io.StringIO()
    writer = csv.writer(sheet, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows([["" if value is None else value for value in line] for line in lines])
    return sheet.getvalue()
