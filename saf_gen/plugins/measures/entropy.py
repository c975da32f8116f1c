"""Entropy of the histogram of counts."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers

LARGEST_TABLE = 1 << 20
"""Number of levels above which counts are sorted instead of tabulated."""


@dataclass(frozen=True)
class HistogramEntropy:
    """Entropy −Σ p·log2 p of the rounded counts, where p is the fraction of pixels at each count level.

    The score depends on how many pixels are at each level, not on where they are: shuffled pixels score the same.
    Multiplying counts by a whole number does not change it (degree 0), but more light fills more levels, about one bit
    per doubling, which no division by brightness undoes. Blur raises the score if the sharp image has few levels, such
    as the two of a test chart.

    Range 0 to log2 of the smaller of N and n + 1 for N pixels and n frames, in bits; degree 0; cost 2: two
    additions per pixel, not counting a logarithm per level.

    References
    ----------
    .. [1] Firestone et al., Cytometry 12(3), 1991, doi:10.1002/cyto.990120302.
    .. [2] HISE in Pertuz et al., Pattern Recognition 46(5), 2013, doi:10.1016/j.patcog.2012.11.011.
    """

    degree: ClassVar[int] = 0
    cost: ClassVar[float] = 2.0
    score_range: ClassVar[str] = "0 ... log2(min(N, n + 1)) bits for N pixels and n frames"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type, in bits."""
        levels = np.rint(as_integers(counts)).ravel()
        low, high = levels.min(), levels.max()
        if high - low < LARGEST_TABLE:
            pixels = np.bincount((levels - low).astype(np.int64))
        else:
            pixels = np.unique(levels, return_counts=True)[1]
        fraction = pixels[pixels > 0] / levels.size
        return 0.0 - float((fraction * np.log2(fraction)).sum())  # not -0.0 for a single level
