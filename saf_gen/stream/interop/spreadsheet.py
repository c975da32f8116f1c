"""The first sheet of an .xlsx file as text.

Such a file is a zip of XML, and a small table needs only four kinds of element. We use our own parser instead of a
library, because the table has only a few rows and the file comes from an untrusted source. Sizes are bounded, and a
document type, with which XML can grow without bound, is refused.
"""

import re
import zipfile
import zlib
from pathlib import Path
from xml.etree import ElementTree

from saf_gen.errors import BadInput
from saf_gen.stream.interop.array_files import open_member

MAX_BYTES, MIN_BYTES, MAX_RATIO = 8 << 20, 1 << 16, 100
"""Largest size, in bytes, of a part of the file after decompression: MAX_RATIO times the file, within these bounds."""
MAX_COLUMNS = 256
"""Columns of a table; the name of a cell states its column, and a row is filled up to it."""
SHEET, TEXTS = "xl/worksheets/sheet1.xml", "xl/sharedStrings.xml"
_DAMAGE = (
    *(OSError, EOFError, KeyError, IndexError, ValueError, RuntimeError),  # NotImplementedError is a RuntimeError
    *(zipfile.BadZipFile, zlib.error, ElementTree.ParseError),
)
_NAME = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"


def read_sheet(path: str | Path) -> list[list[str]]:
    """Return the rows of the first sheet, from its first column; an empty cell is "".

    Raises BadInput if the file is missing, too large, or not a spreadsheet.
    """
    where = str(path)
    try:
        limit = min(max(MAX_RATIO * Path(path).stat().st_size, MIN_BYTES), MAX_BYTES)
        with zipfile.ZipFile(path) as archive:
            sheet = _read_part(archive, SHEET, where=where, limit=limit)
            texts = _read_part(archive, TEXTS, where=where, limit=limit) if TEXTS in archive.namelist() else None
            shared = [] if texts is None else ["".join(t.itertext()) for t in texts.iter(f"{_NAME}si")]
            return [_read_row(row, shared) for row in sheet.iter(f"{_NAME}row")]
    except _DAMAGE as error:
        raise BadInput(f"cannot be read: {error}", where=where, allowed="a spreadsheet (.xlsx)") from error


def _read_part(archive: zipfile.ZipFile, name: str, *, where: str, limit: int) -> ElementTree.Element:
    with open_member(archive, name) as file:
        text = file.read(limit + 1)
    if len(text) > limit:
        raise BadInput(f"{name} is larger than {limit:,} bytes", where=where, allowed="a table of recordings")
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise BadInput(f"{name} declares a document type", where=where, allowed="plain XML")
    return ElementTree.fromstring(text)


def _read_row(row: ElementTree.Element, shared: list[str]) -> list[str]:
    cells: list[str] = []
    for cell in row.iter(f"{_NAME}c"):
        letters = re.match(r"[A-Z]{1,3}", cell.get("r", ""))
        column = len(cells)
        if letters:
            column = 0
            for letter in letters[0]:
                column = 26 * column + ord(letter) - ord("A") + 1
            column -= 1
        if column >= MAX_COLUMNS:
            raise ValueError(f"it has a cell {cell.get('r')}; allowed: {MAX_COLUMNS} columns")
        cells += [""] * (column - len(cells))
        value = cell.find(f"{_NAME}v")
        text = "".join(cell.itertext()) if value is None else value.text or ""
        cells.append(shared[int(text)] if cell.get("t") == "s" else text)
    return cells
