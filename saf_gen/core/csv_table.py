"""Small CSV tables that a recipe names by their path and that are read together with the recipe.

The text of a table becomes part of the recipe: an edited table makes a different recipe, and moving a table away
later does no harm.
"""

from collections.abc import Iterator, Mapping
from functools import lru_cache
from math import isfinite
from pathlib import Path

import numpy as np

from saf_gen.errors import BadInput, closest

MAX_TABLE_BYTES = 4 << 20  # every file of the dataset contains a copy
MAX_LOG_BYTES = 1 << 27
"""Largest log of a recording, about six minutes of readouts; ten seconds to read."""
PIECE = 1 << 20


def read_text_in(folder: str | Path, name: str, *, where: str = "") -> str:
    """Return the text of the file ``name`` in ``folder`` or one of its subfolders.

    ``where`` is the file and line in which the name was found. Raises BadInput if the path leads out of the folder,
    also through a link, or the file is missing, larger than 4 MiB, or not UTF-8 text.
    """
    root = Path(folder).resolve()
    try:
        path = (root / name).resolve()
    except (OSError, RuntimeError, ValueError) as error:  # circular links, or a name with a zero byte
        raise BadInput(f"{name!r} cannot be resolved: {error}", where=where) from error
    if not path.is_relative_to(root):
        raise BadInput(
            f"{name!r} is outside the folder of the file that names it",
            where=where,
            allowed=f"a file in {root} or its subfolders",
            hint="copy it there",
        )
    try:
        if path.exists() and not path.is_file():
            raise BadInput(f"{name!r} is a folder, a pipe or a device", where=where, allowed="a file")
        if path.stat().st_size > MAX_TABLE_BYTES:
            raise BadInput(
                f"{name!r} has {path.stat().st_size} bytes",
                where=where,
                allowed=f"at most {MAX_TABLE_BYTES}",
                hint="remove rows: values between two rows are interpolated linearly",
            )
        return path.read_text(encoding="utf-8-sig")  # spreadsheets write a byte order mark
    except FileNotFoundError:
        near = closest(path.name, [p.name for p in path.parent.glob(f"*{path.suffix}")])
        nearest = str(Path(name).with_name(near)) if near else ""
        raise BadInput(f"{name!r} does not exist", where=where, allowed=f"a file in {root}", nearest=nearest) from None
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{name!r} cannot be read: {error}", where=where) from error


def parse_csv(file: object, names: tuple[str, ...]) -> tuple[np.ndarray, ...]:
    """Return the columns of a table that a recipe holds as ``{"path": ..., "text": ...}``.

    Raises BadInput if ``file`` is anything else, or if :func:`parse_columns` refuses the text.
    """
    if not (isinstance(file, Mapping) and set(file) == {"path", "text"}):
        allowed = "the path of a CSV file in a recipe; elsewhere {'path': ..., 'text': ...}"
        raise BadInput(f"file is {file!r}", allowed=allowed)
    return parse_columns(file["text"], names, name=file["path"])


@lru_cache(maxsize=64)
def parse_columns(text: str, names: tuple[str, ...], *, name: str, rising: bool = True) -> tuple[np.ndarray, ...]:
    """Return the columns of a CSV text as read-only arrays, float64 (N,) each; the first one rises from row to row.

    The first line contains the ``names``, in order. Empty lines and lines that begin with # are skipped. ``name`` is
    the name of the file in errors. If ``rising`` is false, the first column may hold any numbers.

    Rows are read a piece of the text at a time, so that a table takes little more memory than its numbers and its text.
    Raises BadInput, with the line, if the heading differs, a row has too many or too few cells, a value is not a finite
    number, the first column does not rise, or the table has no rows.
    """
    first, heading = find_heading(text)
    if tuple(cell.strip() for cell in heading.split(",")) != names:
        if not heading:
            raise BadInput("the table has no rows", where=name, allowed=f"{','.join(names)}, then numbers")
        raise BadInput(f"the columns are {heading.strip()!r}", where=f"{name}:{first}", allowed=",".join(names))
    pieces = [np.empty((0, len(names)))]
    for number, lines in _pieces(text):
        rows = [(n, line) for n, line in enumerate(lines, start=number) if n > first and not _says_nothing(line)]
        try:
            table = _read_fast([line for _, line in rows], len(names))
        except ValueError:  # a fault, which is named, or a number that only Python reads
            table = np.array([_row(line, names, where=f"{name}:{n}") for n, line in rows])
        last = pieces[-1][-1:]
        if rising and len(wrong := np.flatnonzero(~(np.diff(np.concatenate([last, table])[:, 0]) > 0))):
            at = int(wrong[0]) + 1 - len(last)
            before = table[at - 1, 0] if at else last[0, 0]
            raise BadInput(
                f"{names[0]} goes from {before:g} to {table[at, 0]:g}", where=f"{name}:{rows[at][0]}",
                allowed="a column that rises",
            )  # fmt: skip
        pieces += [table] if len(table) else []
    columns = np.concatenate(pieces).T.copy()
    if not columns.size:
        raise BadInput("the table has no rows", where=name, allowed=f"{','.join(names)}, then numbers")
    columns.flags.writeable = False
    return tuple(columns)


def find_heading(text: str) -> tuple[int, str]:
    """Return the number and the text of the first line of a table that says something; (0, "") if there is none."""
    lines = ((n, line) for number, piece in _pieces(text) for n, line in enumerate(piece, start=number))
    return next(((n, line) for n, line in lines if not _says_nothing(line)), (0, ""))


def _says_nothing(line: str) -> bool:
    return not line.strip() or line.startswith("#")


def _pieces(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the lines of a text, about PIECE characters at a time, with the number of the first."""
    begin, number = 0, 1
    while begin < len(text):
        end = text.find("\n", begin + PIECE)
        lines = (text[begin : len(text) if end < 0 else end] + "\n").splitlines()
        yield number, lines
        number += len(lines)
        begin = len(text) if end < 0 else end + 1


def _read_fast(lines: list[str], columns: int) -> np.ndarray:
    """Return a table, float64 (row, column); raise ValueError if a row does not have so many finite numbers."""
    if not lines:
        return np.empty((0, columns))
    table = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)
    if table.shape != (len(lines), columns) or not np.isfinite(table).all():
        raise ValueError
    return table


def _row(line: str, names: tuple[str, ...], *, where: str) -> list[float]:
    cells = [cell.strip() for cell in line.split(",")]
    if len(cells) != len(names):
        raise BadInput(f"the row is {line.strip()!r}", where=where, allowed=f"{len(names)} numbers")
    return [_number(cell, column, where=where) for cell, column in zip(cells, names, strict=True)]


def _number(cell: str, column: str, *, where: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise BadInput(f"{column} is {cell!r}", where=where, allowed="a finite number")
    return value
