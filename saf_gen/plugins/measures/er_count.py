"""Event rate taken literally: the number of spikes."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers


@dataclass(frozen=True)
class EventRateCount:
    """Sum of counts, Σc: a measure of brightness alone, and the baseline that a focus measure has to beat.

    If the sum is divided by brightness (``er_count_n``), it is N for every window with a spike, so this form cannot
    distinguish windows.

    Range 0 to N·n for N pixels and n frames; degree 1; cost 1: an addition per pixel.

    References
    ----------
    Events are replaced by spikes in Lin et al., CVPR 2022, doi:10.1109/CVPR52688.2022.01586.
    """

    degree: ClassVar[int] = 1
    cost: ClassVar[float] = 1.0
    score_range: ClassVar[str] = "0 ... N n for N pixels and n frames"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type."""
        return float(as_integers(counts).sum())
