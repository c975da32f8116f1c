"""Writes spreadsheets like those in SAF's folders."""

from openpyxl import Workbook

HEADING = ("id", "scene name", "frames", "focal frame", "dt", "path")


def write_xlsx(path, rows):
    """Write rows of numbers and texts as the first of two sheets."""
    book = Workbook()
    for row in rows:
        book.active.append(row)
    book.create_sheet("notes").append(["nothing"])
    book.save(path)
