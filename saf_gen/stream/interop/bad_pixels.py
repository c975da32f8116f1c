"""Masks of bad pixels in files of others."""

import re
from pathlib import Path

import numpy as np

from saf_gen.core.config.document import read_text
from saf_gen.core.csv_table import MAX_LOG_BYTES, find_heading, parse_columns
from saf_gen.errors import BadInput, unknown
from saf_gen.stream.interop.array_files import ENDINGS, open_array
from saf_gen.stream.interop.picture_frames import open_pictures

PICTURES = (".png", ".bmp", ".tif", ".tiff", ".pgm", ".pbm")
"""Endings of pictures that store each pixel as it is; JPEG does not."""
HEADINGS = ("row,column", "row,col")
MAX_MASKED = 0.5
"""Largest fraction of the pixels that a file may mark; if it marks more, it probably marks the good ones."""


def read_mask(text: str, shape: tuple[int, int]) -> np.ndarray:
    """Return the bad pixels that a file marks, bool (H, W), row 0 at the top.

    Parameters
    ----------
    text : str
        Path of a picture or of an array (rows, columns) in which bad pixels are not 0, or of a CSV table with the
        columns ``row,column``, counted from 0. ``FILE.npz:NAME`` and ``FILE.mat:NAME`` name one of several arrays.
    shape : tuple of int
        Rows and columns of the recording.

    Raises
    ------
    BadInput
        If the file cannot be read, is of another kind, has another size or values that are not finite, or marks more
        than half of the pixels.
    """
    match = re.fullmatch(r"(.+\.(?:npz|mat)):([^/\\:]+)", text, flags=re.IGNORECASE)
    path, key = (Path(match[1]), match[2]) if match else (Path(text), None)
    ending = path.suffix.lower()
    if not path.is_file():
        raise BadInput("there is no such file", where=str(path), allowed="a mask")
    if ending in ENDINGS:
        mask = _read_array(path, key, shape=shape)
    elif ending in PICTURES:
        pages = [page > 0 for page in open_pictures(path, linear=True)]
        if len(pages) > 1:
            raise BadInput(f"has {len(pages)} pages", where=str(path), allowed="one picture")
        mask = pages[0]
    elif ending == ".csv":
        return _checked(_read_places(path, shape), path)
    else:
        raise unknown("kind of mask", path.suffix, allowed=(*ENDINGS, *PICTURES, ".csv"), where=str(path))
    _check_size(mask.shape, shape, path=path)
    return _checked(mask, path)


def _check_size(found: tuple[int, ...], shape: tuple[int, int], *, path: Path) -> None:
    if found != shape:
        raise BadInput(
            f"the mask has {' × '.join(map(str, found))} pixels", where=str(path),
            allowed=f"{shape[0]} rows × {shape[1]} columns, as in the recording",
        )  # fmt: skip


def _checked(mask: np.ndarray, path: Path) -> np.ndarray:
    if np.count_nonzero(mask) > MAX_MASKED * mask.size:
        raise BadInput(
            f"marks {np.count_nonzero(mask)} of {mask.size} pixels as bad", where=str(path),
            allowed="at most half of them", hint="turn the mask around: bad pixels are not 0, good ones are 0",
        )  # fmt: skip
    return mask


def _read_array(path: Path, key: str | None, *, shape: tuple[int, int]) -> np.ndarray:
    array = open_array(path, key=key, axes=2)
    if array.dtype.kind not in "buif" or len(array.shape) != 2:
        raise BadInput(f"the array is {array.dtype} {array.shape}", where=str(path), allowed="numbers (rows, columns)")
    # The last axis of a .mat file comes first. The size is compared before the values are read, as they may be many.
    is_matlab = path.suffix.lower() == ".mat"
    _check_size(array.shape[::-1] if is_matlab else array.shape, shape, path=path)
    values = np.asarray(array[slice(0, array.shape[0])])
    if not np.isfinite(values).all():
        raise BadInput("the array holds values that are not finite", where=str(path), allowed="0 for good pixels")
    return (values.T if is_matlab else values) != 0


def _read_places(path: Path, shape: tuple[int, int]) -> np.ndarray:
    table = read_table(path, HEADINGS)
    mask = np.zeros(shape, bool)
    for (name, values), size in zip(table.items(), shape, strict=True):
        wrong = values[(values % 1 != 0) | (values < 0) | (values >= size)]
        if wrong.size:
            raise BadInput(f"{name} is {wrong[0]:g}", where=str(path), allowed=f"0 to {size - 1}, counted from 0")
    mask[tuple(values.astype(int) for values in table.values())] = True
    return mask


def read_table(path: Path, headings: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Return the columns of a CSV file with one of these headings by name, float64 (N,) each, in the order of its rows.

    Raises BadInput if the file cannot be read or has another heading, or if a row does not hold finite numbers.
    """
    text = read_text(path, max_bytes=MAX_LOG_BYTES).removeprefix("\ufeff")
    _, heading = find_heading(text)
    names = tuple(cell.strip() for cell in heading.split(","))
    if ",".join(names) not in headings:
        raise BadInput(f"the columns are {heading.strip()!r}", where=str(path), allowed=" or ".join(headings))
    return dict(zip(names, parse_columns(text, names, name=str(path), rising=False), strict=True))
