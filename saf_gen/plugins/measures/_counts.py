"""The counts that measures compute with: any number type, brought to one whose sums are exact."""

import numpy as np

from saf_gen.errors import BadInput

MIN_LIGHT_OVER_DARK = 0.1
"""Smallest ratio of mean light to mean dark counts at which light is told from night."""

GROWTH = 512
"""No measure of this package gives more than this many sums of squared counts (weight 20, squared)."""


def counts_as_integers(counts: np.ndarray, *, halves: bool = False) -> np.ndarray:
    """Return counts as int64 where sums of their squares stay exact in it, else as float64.

    Rows lie one after the other in memory, so that sums of floats do not depend on the input's layout. ``counts`` is an
    array of any number type, (row, col), or (2, row, col) with ``halves``, the two halves of a window. Raises BadInput
    for other axes, for no pixel, and for values that are no finite numbers.
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


def counts_as_floats(counts: np.ndarray) -> np.ndarray:
    """Return counts (row, col) as float64, for sums that are not exact anyway. Raise as counts_as_integers does."""
    return counts_as_integers(counts).astype(np.float64)


def subtract_dark_counts(
    means: tuple[float, float], rate: float, *, frames: int
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Split the mean counts of both halves of a window into light and dark, counts per pixel.

    ``rate`` is that of dark spikes per pixel and readout, ``frames`` the length of both halves together.
    Returns the light and the dark of each half, or None where a half holds hardly any light.
    """
    dark = rate * (frames // 2), rate * (frames - frames // 2)
    light = means[0] - dark[0], means[1] - dark[1]
    if light[0] <= MIN_LIGHT_OVER_DARK * dark[0] or light[1] <= MIN_LIGHT_OVER_DARK * dark[1]:
        return None
    return light, dark
