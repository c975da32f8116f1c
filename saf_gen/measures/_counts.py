"""Numbers that measures compute with: counts of any type, so that sums of whole numbers stay exact."""

import numpy as np

from saf_gen.errors import BadInput

__all__ = ["as_numbers"]

GROWTH = 256
"""No measure here gives more than this many sums of squared counts (4x4 kernel of ones, squared)."""


def as_numbers(counts: np.ndarray) -> np.ndarray:
    """``counts`` (row, col) as int64 where they are whole numbers whose squares sum up in it, else float64.

    Raises BadInput unless there are two axes, at least one pixel, and finite numbers.
    """
    given = np.asarray(counts)
    if given.ndim != 2 or given.size == 0:
        raise BadInput(f"counts have shape {given.shape}", allowed="(rows, columns), at least one pixel")
    if given.dtype.kind not in "buif":
        raise BadInput(f"counts have dtype {given.dtype}", allowed="numbers")
    if given.dtype.kind == "f":
        if not np.isfinite(given).all():
            raise BadInput("counts hold values that are not finite", allowed="finite numbers")
        return given.astype(np.float64)
    largest = max(int(given.max()), -int(given.min()))
    fits = GROWTH * given.size * largest**2 < 2**63
    return given.astype(np.int64 if fits else np.float64)
