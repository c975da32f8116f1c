"""Checked windows of frames, regions of pixels, and what follows from a target mask: its box, and what lies inside."""

import operator

import numpy as np

from saf_gen.errors import BadInput

Region = tuple[slice, slice]
"""Slices of rows and columns, with step 1."""
REGIONS = ("target", "inside", "frame", "shifted", "half", "double", "centre")
"""Where a method may look: the bounding box of the target, the largest rectangle inside the target, the whole frame, or
a box that a camera may choose instead: the target's box moved sideways by half its width, of half or twice its size, or
the middle half of the frame."""
MARGIN = 3
"""Pixels by which a target mask is eroded for the region ``inside``."""
MIN_SIDE = 24
"""Least number of rows and of columns of the region ``inside``."""


def validate_window(first: int, stop: int, *, total: int, what: str = "frames", where: str = "") -> range:
    """Return the window ``first <= t < stop`` of ``total`` frames as a range; ``what`` names what is counted.

    Raises BadInput unless both ends are whole numbers with 0 <= first < stop <= total.
    """
    try:
        window = range(operator.index(first), operator.index(stop))
    except TypeError:
        window = range(0)
    if not (0 <= window.start < window.stop <= total):
        raise BadInput(
            f"{what} {first} to {stop} were asked for",
            where=where,
            allowed=f"whole numbers, 0 <= first < stop <= {total}",
        )
    return window


def validate_region(region: Region | None, size: tuple[int, int], *, where: str = "") -> Region:
    """Return ``region`` with the ends of its slices filled in; None means the whole frame of ``size`` (rows, columns).

    Raises BadInput if the region is empty, leaves the frame, or has a step other than 1.
    """
    bounds = []
    spans = region or (slice(None), slice(None))
    for span, length, axis in zip(spans, size, ("rows", "columns"), strict=True):
        first = 0 if span.start is None else operator.index(span.start)
        stop = length if span.stop is None else operator.index(span.stop)
        if not 0 <= first < stop <= length or span.step not in (None, 1):
            raise BadInput(
                f"the region's {axis} are {span}", where=where, allowed=f"0 <= first < stop <= {length}, step 1"
            )
        bounds.append(slice(first, stop))
    return bounds[0], bounds[1]


def region_shape(region: Region) -> tuple[int, int]:
    """Return the numbers of rows and columns of a region whose ends are filled in."""
    return region[0].stop - region[0].start, region[1].stop - region[1].start


def bounding_box(target: np.ndarray) -> Region:
    """Return the bounding box of a target mask, bool (H, W); raise BadInput if it marks no pixel."""
    mask = np.asarray(target, dtype=bool)
    if mask.ndim != 2 or not mask.any():
        raise BadInput(
            f"target mask of shape {mask.shape} marks {int(mask.sum())} pixels",
            allowed="(rows, columns), at least one pixel marked",
            hint="use the whole frame: --region frame",
        )
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def inside_box(target: np.ndarray) -> Region | None:
    """Return the largest rectangle inside a target mask, bool (H, W), after the mask is eroded by MARGIN pixels.

    A pixel stays if all pixels up to MARGIN rows and columns away belong to the target. The frame's edge erodes as the
    target's own does: blur may leak in from beyond it, and nobody knows what is there. Of equal areas, the topmost
    rectangle is returned, of these the leftmost, and of these the tallest.

    Parameters
    ----------
    target : ndarray of bool, shape (H, W)
        The target mask.

    Returns
    -------
    Region or None
        Rows and columns, at least MIN_SIDE of each; None if no such rectangle is inside.

    Notes
    -----
    Each row is a histogram of how far the target goes on above it. A stack of bars of rising height gives all largest
    rectangles that end in the row, in a time that grows with the number of pixels.
    """
    mask = _erode(np.asarray(target, dtype=bool))
    heights = np.zeros(mask.shape[1], dtype=np.int64)
    best, box = (0, 0, 0, 0), None
    for bottom, row in enumerate(mask, start=1):
        heights = np.where(row, heights + 1, 0)
        if heights.max(initial=0) < MIN_SIDE:
            continue
        bars: list[tuple[int, int]] = []  # first column and height of each bar that still goes on
        for column, height in enumerate([*heights.tolist(), 0]):
            left = column
            while bars and bars[-1][1] >= height:
                left, tall = bars.pop()
                rank = tall * (column - left), tall - bottom, -left, tall
                if min(tall, column - left) >= MIN_SIDE and rank > best:
                    best, box = rank, (slice(bottom - tall, bottom), slice(left, column))
            bars.append((left, height))
    return box


def _erode(mask: np.ndarray) -> np.ndarray:
    """Return which pixels of a mask (H, W) have only marked pixels up to MARGIN rows and columns away."""
    height, width = mask.shape
    side = range(2 * MARGIN + 1)
    padded = np.pad(mask, MARGIN)
    rows = np.logical_and.reduce([padded[n : n + height] for n in side])
    return np.asarray(np.logical_and.reduce([rows[:, n : n + width] for n in side]))


def place_box(region: str, box: Region, *, size: tuple[int, int]) -> Region:
    """Return the box of a region of REGIONS for the ``box`` of the target, inside ``size``; not of frame or inside.

    A box that is shifted moves to larger columns, or to smaller ones where there is more room. One that is resized
    keeps its middle, and is cut off at the edges of the frame; at least one pixel is left.
    """
    if region == "centre":
        return slice(size[0] // 4, size[0] - size[0] // 4), slice(size[1] // 4, size[1] - size[1] // 4)
    if region == "shifted":
        rows, columns = box
        by, left, right = (columns.stop - columns.start) // 2, columns.start, size[1] - columns.stop
        by = min(by, right) if right >= left else -min(by, left)
        return rows, slice(columns.start + by, columns.stop + by)
    factor = {"target": 1.0, "half": 0.5, "double": 2.0}[region]
    rows, columns = (_resize(span, factor, length=length) for span, length in zip(box, size, strict=True))
    return rows, columns


def _resize(span: slice, factor: float, *, length: int) -> slice:
    width = span.stop - span.start
    new = max(round(width * factor), 1)
    first = span.start + (width - new) // 2
    return slice(max(first, 0), min(first + new, length))


def decile_pixels(best_position: np.ndarray) -> tuple[int, int]:
    """Return which pixels (pixel,) have a tenth of all best positions below, and above, their own."""
    order = np.argsort(best_position, kind="stable")
    first, last = (int(order[int(share * (order.size - 1))]) for share in (0.1, 0.9))
    return first, last
