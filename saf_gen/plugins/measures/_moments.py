"""Moments of counts, exact for whole numbers."""

import numpy as np

from saf_gen.plugins.measures._counts import as_integers


def sum_of_squares(numbers: np.ndarray) -> int | float:
    """Return the sum of squares of an array of any shape: an exact int for int64, otherwise a float."""
    return np.vdot(numbers, numbers).item()


def mean_square(numbers: np.ndarray) -> float:
    """Return the mean of squared numbers of any shape, 0.0 for an empty array."""
    return sum_of_squares(numbers) / numbers.size if numbers.size else 0.0


def variance(numbers: np.ndarray) -> float:
    """Return the mean square of the deviations from the mean, 0.0 for an empty array.

    ``numbers`` is a result of as_integers, or whole-number sums of it. For whole numbers, N·Σc² − (Σc)² is
    computed in Python integers, as in squared_contrast.
    """
    if not numbers.size:
        return 0.0
    size, total = numbers.size, numbers.sum().item()
    if isinstance(total, int):
        return (size * sum_of_squares(numbers) - total**2) / size**2
    return sum_of_squares(numbers - total / size) / size


def squared_contrast(counts: np.ndarray, *, pixels: bool = False) -> float:
    """Return the variance of counts (row, col) divided by their squared mean, times N if ``pixels``.

    Returns 0.0 for a mean of 0. For whole numbers, N·Σc² − (Σc)² is computed in Python integers, so that only the
    quotient is rounded. Deviations from a mean in floats would leave the score of a constant image slightly above 0.
    """
    numbers = as_integers(counts)
    size, total = numbers.size, numbers.sum().item()
    if total == 0:
        return 0.0
    if isinstance(total, int):
        spread = size * sum_of_squares(numbers) - total**2
        return (size * spread if pixels else spread) / total**2
    mean = total / size
    contrast = sum_of_squares(numbers / mean - 1.0) / size
    return size * contrast if pixels else contrast
