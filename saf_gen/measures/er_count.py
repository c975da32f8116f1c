"""Event rate taken word for word: how many spikes there are."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.measures._counts import as_numbers


@dataclass(frozen=True)
class EventRateCount:
    """Sum of counts, Σc: brightness and nothing else. The floor that a focus measure has to beat.

    Range 0 ... N·n for windows of n frames, degree 1, cost 1: an addition a pixel. Its twin is N wherever
    there is a spike, so it cannot tell windows apart.
    """

    degree: ClassVar[int] = 1
    cost: ClassVar[float] = 1.0
    source: ClassVar[str] = (
        "Lin et al., Autofocus for Event Cameras, CVPR 2022, doi:10.1109/CVPR52688.2022.01586, "
        "with spikes in place of events"
    )
    score_range: ClassVar[str] = "0 ... N n for N pixels and n frames"

    def __call__(self, counts: np.ndarray) -> float:
        """Score of counts (row, col), any number type."""
        return float(as_numbers(counts).sum())
