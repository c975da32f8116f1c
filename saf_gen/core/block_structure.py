"""Blocks of a picture and their fine structure: the sums of the measure of that name, for it and for searches."""

import numpy as np
from numba import njit

WEIGHTS = np.array([-4.0, 5.0, 0.0, -1.0])
"""Weights of S(1) … S(4). Their sum is 0, so that white noise cancels, and so is the sum of weight·distance², so that a
gradient of brightness cancels."""


@njit(nogil=True, cache=True)
def block_structure(c: np.ndarray, edges: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return the fine structure of blocks of counts ``c`` (row, col), (n, m), for int64 edges (n + 1,), (m + 1,).

    A pair of pixels belongs to the block of its upper or left pixel. Sums of whole counts are exact. The loop is
    compiled because temporary arrays for each distance would cost more than the arithmetic.
    """
    rows, columns = c.shape
    row_edges, column_edges = edges
    scores = np.zeros((row_edges.size - 1, column_edges.size - 1))
    for p in range(row_edges.size - 1):
        for q in range(column_edges.size - 1):
            light = c[0, 0] * 0
            pixels = (row_edges[p + 1] - row_edges[p]) * (column_edges[q + 1] - column_edges[q])
            for i in range(row_edges[p], row_edges[p + 1]):
                for j in range(column_edges[q], column_edges[q + 1]):
                    light += c[i, j]
            if light <= 0:
                continue
            for apart in range(1, WEIGHTS.size + 1):
                if WEIGHTS[apart - 1] == 0:
                    continue
                squares, pairs = c[0, 0] * 0, 0
                for i in range(row_edges[p], row_edges[p + 1]):
                    for j in range(column_edges[q], column_edges[q + 1]):
                        if i + apart < rows:
                            d = c[i + apart, j] - c[i, j]
                            squares += d * d
                            pairs += 1
                        if j + apart < columns:
                            d = c[i, j + apart] - c[i, j]
                            squares += d * d
                            pairs += 1
                if pairs:
                    scores[p, q] += WEIGHTS[apart - 1] * squares / pairs
            scores[p, q] /= (light / pixels) ** 2
    return scores


def block_edges(pixels: int, size: int) -> np.ndarray:
    """Return the edges of blocks of about ``size`` pixels along an axis, int64, from 0 to ``pixels``."""
    return np.linspace(0, pixels, max(pixels // size, 1) + 1).astype(np.int64)
