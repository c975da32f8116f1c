"""Masks of bad pixels: read from files of others, and found in the counts of a recording."""

import re
from collections.abc import Callable
from math import log
from pathlib import Path

import numpy as np
from scipy import ndimage

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

FALSE_FINDS = 0.01
"""Largest expected number of good pixels found in a recording; spikes are more regular than chance, so it is less."""
CLUSTER = 4
"""Largest group of adjacent pixels that is taken to be bad; larger ones may be black or white parts of the scene."""
FACTOR = 2.0
"""How much a good pixel's light may lie beyond what its neighbours suggest: the spread of pixels in a sensor."""
NEAR, FEW = 8.0, 4.0
"""A pixel that fires NEAR times less than those around it is a dark spot of the scene, and the like for bright ones; if
there is one for FEW that never fire, or fire always, these are taken for spots too."""
_AROUND = np.ones((3, 3), bool)


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
        raise BadInput("there is no such file", where=str(path), allowed="a mask, or --mask find")
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


def find_bad_pixels(
    counts: np.ndarray, frames: int, *, wild: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the dead and the stuck pixels that a recording shows, two masks, bool (H, W).

    Dead pixels never fire, stuck ones fire at every readout, in groups of at most CLUSTER, while the good pixels around
    the group do otherwise. The light on a pixel may lie as far beyond the range of the light around it as that range is
    wide, in proportion, and FACTOR further; the chance that any good pixel is then silent, or never silent, is below
    FALSE_FINDS for the recording, even if spikes were as irregular as chance. So nothing is found in the dark or in
    saturated light. No dead pixel is found, either, in a picture with other spots that are nearly as dark, and no stuck
    one beside saturated parts.

    Parameters
    ----------
    counts : ndarray of int, shape (H, W)
        Spikes of each pixel in all frames.
    frames : int
        Number of frames.
    wild : ndarray of bool, shape (H, W), optional
        Pixels that are known to be bad, and say nothing of those beside them.
    """
    limit = log(counts.size / FALSE_FINDS)
    usual = ndimage.median_filter(counts, 5)

    def is_dead(around: np.ndarray) -> bool:
        low, high = float(around.min()), float(around.max())
        return low**2 / high / FACTOR >= limit

    def is_stuck(around: np.ndarray) -> bool:
        low, high = around.min() + 1.0, around.max() + 1.0
        rate = FACTOR * high**2 / low / frames
        return rate < 1 and -frames * log(rate) >= limit

    silent, full = counts == 0, counts == frames
    dark = (counts > 0) & (counts < usual / NEAR)
    bright = (counts < frames) & (frames - counts < (frames - usual) / NEAR)
    good = ~(silent | full) if wild is None else ~(silent | full | wild)
    dead, stuck = (
        _find_groups(silent, counts, good=good, test=is_dead),
        _find_groups(full, counts, good=good, test=is_stuck),
    )
    dark_spots = np.count_nonzero(_find_groups(dark, counts, good=good & ~dark, test=is_dead))
    bright_spots = np.count_nonzero(bright | (full & ~stuck))
    for found, spots in ((dead, dark_spots), (stuck, bright_spots)):
        found &= np.count_nonzero(found) > FEW * spots
    return dead, stuck


MIN_CHANCE = 30.0
"""Least number of pairs that chance would bring, for a pixel to be judged by its pairs."""
MIN_JUDGED = 100
"""Least number of pixels that are judged, for one of them to be called wild."""
EVEN, UNSURE, WILD = 0.1, 0.25, 0.5
"""Pairs beyond even firing, relative to chance: most in the median pixel, most in nearly all, least in wild ones."""
_BYTES = np.arange(256, dtype=np.uint8)
_SPIKES = np.bitwise_count(_BYTES).astype(np.int64)
_FEWEST = np.maximum(2 * _SPIKES - 9, 0)  # n spikes among 8 - n gaps make at least so many pairs
EXCESS_PAIRS = (np.bitwise_count(_BYTES & _BYTES >> 1) - _FEWEST).astype(np.uint8)
"""By byte of 8 readouts: pairs of spikes in a row beyond the fewest that its number of spikes allows."""
CHANCE_PAIRS = (_SPIKES * (_SPIKES - 1) - 8 * _FEWEST).astype(np.uint8)
"""By byte: 8 times the number of these pairs if the spikes lay in any order."""


def find_wild_pixels(pairs: np.ndarray, chance: np.ndarray) -> np.ndarray:
    """Return the pixels that fire as irregularly as chance, in groups of at most CLUSTER, bool (H, W).

    A good pixel fires at nearly equal intervals, so it fires twice in a row no more than its rate demands. Nothing is
    found if that does not hold for most pixels, as in flickering light, or if there is no gap between even and wild
    ones.

    Parameters
    ----------
    pairs, chance : ndarray of int, shape (H, W)
        Sums of EXCESS_PAIRS and of CHANCE_PAIRS over the bytes of each pixel.
    """
    judged = chance >= 8 * MIN_CHANCE
    ratio = np.divide(8 * pairs, chance, out=np.zeros(pairs.shape), where=judged)
    wild = ratio >= WILD
    if np.count_nonzero(judged) < MIN_JUDGED or np.median(ratio[judged]) > EVEN or not wild.any():
        return np.zeros(wild.shape, bool)
    groups, _ = ndimage.label(wild, _AROUND)
    found = wild & (np.bincount(groups.ravel())[groups] <= CLUSTER)
    unsure = np.count_nonzero((ratio > UNSURE) & ~found)
    return found if np.count_nonzero(found) > FEW * unsure else np.zeros_like(found)


def _find_groups(
    suspect: np.ndarray, counts: np.ndarray, *, good: np.ndarray, test: Callable[[np.ndarray], bool]
) -> np.ndarray:
    """Return the groups of suspect pixels that are small, and that the counts of the good pixels around them convict.

    At least half of the places around a group must be good pixels.
    """
    found = np.zeros(suspect.shape, bool)
    groups, number = ndimage.label(suspect, _AROUND)
    small = np.flatnonzero(np.bincount(groups.ravel(), minlength=number + 1)[1:] <= CLUSTER)
    boxes = ndimage.find_objects(groups)
    for index in small:
        rows, columns = boxes[index]
        box = slice(max(rows.start - 1, 0), rows.stop + 1), slice(max(columns.start - 1, 0), columns.stop + 1)
        group = groups[box] == index + 1
        around = ndimage.binary_dilation(group, _AROUND) & ~group
        neighbours = counts[box][around & good[box]]
        if 2 * neighbours.size >= np.count_nonzero(around) and test(neighbours):
            found[box] |= group
    return found
