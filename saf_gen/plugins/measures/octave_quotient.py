"""Quotient of octaves: the share of fine structure in all structure, which hardly changes with the light."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from saf_gen.plugins.measures._counts import as_integers

OCTAVES = 5
"""Number of distances between pixels: 1, 2, 4, 8 and 16."""
ERROR = 4.0
"""Standard errors of white noise, as large as all differences of neighbours, that are added to the structure."""


@dataclass(frozen=True)
class OctaveQuotient:
    """Share of the two finest octaves in the structure of a picture.

    The score is

        (D₁ + D₂/2) / (D₁ + D₂ + D₄ + D₈ + 4·S(1)/√N)
        D_l = S(2l) − S(l);  S(l) = mean over rows of (c(x + l) − c(x))², plus the same over columns

    for counts c of N pixels; S is the second-order structure function, as in ``octave_structure``. White noise adds
    the same amount to S at every distance and cancels in each D. Whatever changes the contrast of all scales alike
    cancels in the quotient: the gain of the light, dark spikes, and mostly a lamp that goes out. No mean and no
    calibration is needed. Blur removes the finest octaves first, so the share falls on both sides of the focus.

    If a picture has no structure, both parts of the quotient are noise. The last term, four times the standard error of
    the sum if all differences of neighbours were noise, then keeps the score near 0; in a picture with structure it
    is a few percent. A numerator or a sum of D below 0 counts as 0, and distances that do not fit into the image are
    left out.

    The share of a pattern with a single period does not change with blur, and for periods of 2 to 5 pixels some D are
    below 0, so the score is not highest at the focus of halftones, weaves, meshes and displays. ``agreed_peak``
    therefore compares it with ``split_gradient``.

    Range: 0 for noise, up to 1 for structure in the finest octave alone; degree 0; cost 30: per distance and axis a
    difference, a product and an addition.

    References
    ----------
    This project. Structure functions: A. N. Kolmogorov, Dokl. Akad. Nauk SSSR 30, 1941.
    """

    degree: ClassVar[int] = 0
    cost: ClassVar[float] = 30.0
    score_range: ClassVar[str] = "0 ... 1"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type."""
        image = as_integers(counts)
        narrow = image.astype(np.int32) if image.dtype == np.int64 else image  # twice as fast, and they fit
        s = [value for value in structure(narrow).tolist() if not math.isnan(value)]
        if len(s) < 2:
            return 0.0
        fine = s[1] - s[0] + (s[2] - s[1]) / 2 if len(s) > 2 else s[1] - s[0]
        total = max(s[-1] - s[0], 0.0) + ERROR * s[0] / math.sqrt(image.size)
        return min(max(fine, 0.0) / total, 1.0) if total > 0 else 0.0


@njit(nogil=True, cache=True)
def structure(c: np.ndarray) -> np.ndarray:
    """Return S(1), S(2), … S(16) of counts (row, col), int32 or float64; NaN for distances that do not fit.

    Sums of int32 counts are exact. The loop is compiled because temporary arrays for each distance would cost more than
    the arithmetic.
    """
    rows, cols = c.shape
    out = np.full(OCTAVES, np.nan)
    for k in range(OCTAVES):
        apart = 1 << k
        if apart >= rows or apart >= cols:
            break
        down = across = c[0, 0] * 0
        for i in range(rows - apart):
            for j in range(cols):
                d = c[i + apart, j] - c[i, j]
                down += d * d
        for i in range(rows):
            for j in range(cols - apart):
                d = c[i, j + apart] - c[i, j]
                across += d * d
        out[k] = down / ((rows - apart) * cols) + across / (rows * (cols - apart))
    return out
