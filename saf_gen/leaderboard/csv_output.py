"""CSV files for programs."""

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any


def format_csv(header: Sequence[str], lines: Iterable[Sequence[Any]]) -> str:
    """Return a CSV text with one header line; None becomes an empty field."""
    sheet = io.StringIO()
    csv.writer(sheet, lineterminator="\n").writerows([header, *lines])
    return sheet.getvalue()
