"""Moments of counts, exact for whole numbers."""

import numpy as np

from saf_gen.measures._counts import as_numbers

__all__ = ["squared_contrast", "sum_of_squares"]


def sum_of_squares(numbers: np.ndarray) -> int | float:
    """Sum of squared numbers of any shape: an exact int for int64 (see as_numbers), else a float."""
    return np.vdot(numbers, numbers).item()


def squared_contrast(counts: np.ndarray, *, pixels: bool = False) -> float:
    """Variance over squared mean of counts (row, col), times N where ``pixels``; 0.0 for a mean of 0.

    Whole numbers go through N·Σc² − (Σc)² in Python integers: exact up to the one rounding of the quotient,
    where deviations from a mean in floats would leave a constant image a little above 0.
    """
    numbers = as_numbers(counts)
    size, total = numbers.size, numbers.sum().item()
    if total == 0:
        return 0.0
    if isinstance(total, int):
        spread = size * sum_of_squares(numbers) - total**2
        return (size * spread if pixels else spread) / total**2
    mean = total / size
    contrast = sum_of_squares(numbers / mean - 1.0) / size
    return size * contrast if pixels else contrast
