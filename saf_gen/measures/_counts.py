"""Numbers that measures compute with: counts of any type, so that sums of whole numbers stay exact."""

import numpy as np

from saf_gen.errors import BadInput

__all__ = ["MIN_LIGHT_OVER_DARK", "as_floats", "as_numbers"]

MIN_LIGHT_OVER_DARK = 0.1
"""Of the dark counts: a mean light below that is night."""

GROWTH = 512
"""No measure here gives more than this many sums of squared counts (a Laplacian of weight 20, squared)."""


def as_numbers(counts: np.ndarray, *, halves: bool = False) -> np.ndarray:
    """``counts`` (row, col) as int64 where they are whole numbers whose squares sum up in it, else float64.

    With ``halves`` the counts of the two halves of a window, (2, row, col). Rows lie one after the other in
    memory, so that sums of floats do not depend on how the counts lay.
    Raises BadInput for other axes, for no pixel, and for what is no finite number.
    """
    given = np.asarray(counts)
    if halves and (given.ndim != 3 or len(given) != 2 or given.size == 0):
        raise BadInput(
            f"counts have shape {given.shape}",
            allowed="(2, rows, columns), an image for each half of the window, at least one pixel",
            hint="count frames a ... m-1 and m ... b-1 apart",
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
    """``counts`` (row, col) as float64, for what is no sum of products. Raises as as_numbers does."""
    return as_numbers(counts).astype(np.float64)
