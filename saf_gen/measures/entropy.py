"""Entropy of the histogram of counts."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.measures._counts import as_numbers

LARGEST_TABLE = 1 << 20
"""Counts that span more levels than this are sorted, not tabled."""


@dataclass(frozen=True)
class HistogramEntropy:
    """−Σ p·log2 p, in bits, where p is the share of pixels with a count; fractions are rounded first.

    It sees how many levels there are, not where: shuffled pixels score the same. Counts times a whole number
    keep it (degree 0), yet more light fills more levels, about a bit for each doubling, and there is no twin
    to undo that. Blur raises it where a sharp image has few levels (two, for a test chart).

    Range 0 ... log2 of the smaller of N and n + 1 for windows of n frames, degree 0, cost 2: two additions a
    pixel, beside a logarithm a level.
    """

    degree: ClassVar[int] = 0
    cost: ClassVar[float] = 2.0
    source: ClassVar[str] = (
        "Firestone et al., Comparison of autofocus methods for automated microscopy, Cytometry 12(3), 1991, "
        "doi:10.1002/cyto.990120302; HISE of Pertuz et al., Pattern Recognition 46(5), 2013, "
        "doi:10.1016/j.patcog.2012.11.011"
    )
    score_range: ClassVar[str] = "0 ... log2(min(N, n + 1)) bits for N pixels and n frames"

    def __call__(self, counts: np.ndarray) -> float:
        """Score of counts (row, col), any number type, bits."""
        levels = np.rint(as_numbers(counts)).ravel()
        low, high = levels.min(), levels.max()
        if high - low < LARGEST_TABLE:
            held = np.bincount((levels - low).astype(np.int64))
        else:
            held = np.unique(levels, return_counts=True)[1]
        share = held[held > 0] / levels.size
        return 0.0 - float((share * np.log2(share)).sum())  # not -0.0 for a single level
