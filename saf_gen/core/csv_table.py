"""Small CSV tables that a recipe names by their path, read together with the recipe.

Their text becomes part of the recipe: an edited table makes another recipe, and a table that is moved away
later does no harm.
"""

from collections.abc import Mapping
from functools import lru_cache
from math import isfinite
from pathlib import Path

import numpy as np

from saf_gen.errors import BadInput, closest

LARGEST_BYTES = 4 << 20  # every file of the dataset holds a copy


def read_text_beside(folder: str | Path, name: str, *, where: str = "") -> str:
    """Return the text of the file ``name`` in ``folder`` or below it.

    ``where`` is the file and line that name it. Raises BadInput for a path that leads out of the folder, also
    by a link, and for a file that is missing, larger than 4 MiB, or not UTF-8 text.
    """
    root = Path(folder).resolve()
    try:
        path = (root / name).resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a circle of links, or a name with a zero byte
        raise BadInput(f"{name!r} cannot be followed: {error}", where=where) from error
    if not path.is_relative_to(root):
        raise BadInput(
            f"{name!r} lies outside the folder of the file that names it",
            where=where,
            allowed=f"a file in {root}, or below it",
            hint="copy it there",
        )
    try:
        if path.exists() and not path.is_file():
            raise BadInput(f"{name!r} is a folder, a pipe or a device", where=where, allowed="a file")
        if path.stat().st_size > LARGEST_BYTES:
            raise BadInput(
                f"{name!r} has {path.stat().st_size} bytes",
                where=where,
                allowed=f"at most {LARGEST_BYTES}",
                hint="thin it out: between two rows the table is a straight line",
            )
        return path.read_text(encoding="utf-8-sig")  # spreadsheets write a byte order mark
    except FileNotFoundError:
        near = closest(path.name, [p.name for p in path.parent.glob(f"*{path.suffix}")])
        nearest = str(Path(name).with_name(near)) if near else ""
        raise BadInput(f"{name!r} does not exist", where=where, allowed=f"a file in {root}", nearest=nearest) from None
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{name!r} cannot be read: {error}", where=where) from error


def parse_csv_table(file: object, names: tuple[str, ...]) -> tuple[np.ndarray, ...]:
    """Return the columns of a table as a recipe hands it over, ``{"path": ..., "text": ...}``.

    Raises BadInput where ``file`` is something else, and as :func:`parse_csv_columns` does.
    """
    if not (isinstance(file, Mapping) and set(file) == {"path", "text"}):
        allowed = "in a recipe the path of a CSV file; else {'path': ..., 'text': ...}"
        raise BadInput(f"file is {file!r}", allowed=allowed)
    return parse_csv_columns(file["text"], names, name=file["path"])


@lru_cache(maxsize=64)
def parse_csv_columns(text: str, names: tuple[str, ...], *, name: str) -> tuple[np.ndarray, ...]:
    """Return the columns of a CSV text, float64 (N,) each, read-only; the first one rises from row to row.

    The first line holds the ``names`` in their order. Empty lines and lines that begin with # are skipped.
    ``name`` is the name of the file in errors.

    Raises BadInput with the line for another heading, a row that does not fit, a value that is not a finite
    number, a first column that does not rise, or a table without rows.
    """
    rows: list[list[float]] = []
    heading = ""
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        where = f"{name}:{number}"
        cells = [cell.strip() for cell in line.split(",")]
        if not heading:
            heading = line
            if cells != list(names):
                raise BadInput(f"the columns are {line.strip()!r}", where=where, allowed=",".join(names))
            continue
        if len(cells) != len(names):
            raise BadInput(f"the row is {line.strip()!r}", where=where, allowed=f"{len(names)} numbers")
        row = [_number(cell, column, where=where) for cell, column in zip(cells, names, strict=True)]
        if rows and not row[0] > rows[-1][0]:
            raise BadInput(
                f"{names[0]} goes from {rows[-1][0]:g} to {row[0]:g}", where=where, allowed="a rising column"
            )
        rows.append(row)
    if not rows:
        raise BadInput("the table has no rows", where=name, allowed=f"{','.join(names)}, then numbers")
    table = np.array(rows).T
    table.flags.writeable = False
    return tuple(table)


def _number(cell: str, column: str, *, where: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise BadInput(f"{column} is {cell!r}", where=where, allowed="a finite number")
    return value
