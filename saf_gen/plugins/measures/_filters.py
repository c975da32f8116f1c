"""Separable filters, applied only where the kernel fits into the image."""

import numpy as np
from numba import njit


@njit(nogil=True, cache=True)
def correlate_separable(image: np.ndarray, down: np.ndarray, across: np.ndarray, stride: int) -> np.ndarray:
    """Return Σ down[k]·across[l]·image[i + k, j + l] at every ``stride``-th row i and column j.

    All arrays are float64, and the image is at least as large as the filter. The loop over rows is compiled because
    temporary arrays for each step would cost more than the arithmetic.
    """
    rows = (image.shape[0] - down.size) // stride + 1
    cols = (image.shape[1] - across.size) // stride + 1
    out = np.zeros((rows, cols))
    column_sums = np.empty(image.shape[1])
    for i in range(rows):
        column_sums[:] = 0.0
        for k in range(down.size):
            for j in range(image.shape[1]):
                column_sums[j] += down[k] * image[stride * i + k, j]
        for k in range(across.size):
            for j in range(cols):
                out[i, j] += across[k] * column_sums[stride * j + k]
    return out
