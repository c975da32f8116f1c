"""Conversion of counts to a number type in which the sums of measures are exact, and subtraction of dark counts."""

import numpy as np

from saf_gen.errors import BadInput

MIN_LIGHT_OVER_DARK = 0.1
"""Ratio of mean light counts to mean dark counts up to which a half window counts as dark."""

GROWTH = 512
"""Largest factor by which a sum in a measure of this package exceeds Σc²; kernel weights reach 20, and 20² is 400."""


def as_integers(counts: np.ndarray, *, halves: bool = False) -> np.ndarray:
    """Return counts as int64 if sums of their squares are exact in it, otherwise as float64.

    ``counts`` is an array of any number type, (row, col), or (2, row, col) with ``halves``, for the two halves of a
    window. The result is in C order, so that sums of floats do not depend on the memory layout of the input. Raises
    BadInput if the array has other axes or no pixel, or if values are not finite numbers.
    """
    given = np.asarray(counts)
    if halves and (given.ndim != 3 or len(given) != 2 or given.size == 0):
        raise BadInput(
            f"counts have shape {given.shape}",
            allowed="(2, rows, columns), an image for each half of the window, at least one pixel",
            hint="count frames a ... m-1 and m ... b-1 separately",
        )
    if not halves and (given.ndim != 2 or given.size == 0):
        raise BadInput(f"counts have shape {given.shape}", allowed="(rows, columns), at least one pixel")
    if given.dtype.kind not in "buif":
        raise BadInput(f"counts have dtype {given.dtype}", allowed="numbers")
    if given.dtype.kind == "f":
        if not np.isfinite(given).all():
            raise BadInput("counts hold values that are not finite", allowed="finite numbers")
        return given.astype(np.float64, order="C")
    largest = max(int(given.max()), -int(given.min()))
    fits = GROWTH * given.size * largest**2 < 2**63
    return given.astype(np.int64 if fits else np.float64, order="C")


def as_floats(counts: np.ndarray) -> np.ndarray:
    """Return counts (row, col) as float64, for measures whose sums are not exact anyway.

    Raises BadInput if as_integers does.
    """
    return as_integers(counts).astype(np.float64)


def subtract_dark(
    means: tuple[float, float], rate: float, *, frames: int
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Split the mean counts of both halves of a window into light and dark, in counts per pixel.

    ``rate`` is the number of dark spikes per pixel and readout, and ``frames`` the length of both halves together.
    Returns (light of both halves, dark of both halves), or None if the light of a half is at most MIN_LIGHT_OVER_DARK
    times its dark.
    """
    dark = rate * (frames // 2), rate * (frames - frames // 2)
    light = means[0] - dark[0], means[1] - dark[1]
    if light[0] <= MIN_LIGHT_OVER_DARK * dark[0] or light[1] <= MIN_LIGHT_OVER_DARK * dark[1]:
        return None
    return light, dark
