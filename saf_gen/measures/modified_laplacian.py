"""Sum-modified Laplacian: second differences whose signs cannot cancel."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.measures._counts import as_numbers


@dataclass(frozen=True)
class ModifiedLaplacian:
    """Mean of |2c − c(x−s) − c(x+s)| + |2c − c(y−s) − c(y+s)| with ``step`` s, no threshold.

    The two second differences are taken apart, since in the Laplacian they may cancel. Ramps score 0.
    0.0 for fewer than 2s + 1 rows or columns.

    Never rises when a periodic scene is blurred further. Counts, range from 0, degree 1, cost 7: six
    additions and a multiplication a pixel. The magnitude adds up noise, so few counts score high.
    """

    step: int = 1

    degree: ClassVar[int] = 1
    cost: ClassVar[float] = 7.0
    source: ClassVar[str] = (
        "Nayar and Nakagawa, Shape from focus, IEEE TPAMI 16(8), 1994, doi:10.1109/34.308479"
    )
    score_range: ClassVar[str] = "from 0; 0 for constant counts and ramps"

    def __post_init__(self) -> None:
        if isinstance(self.step, bool) or not isinstance(self.step, int) or self.step < 1:
            raise BadInput(f"step is {self.step!r}", allowed="a whole number of pixels, 1 or more")

    def __call__(self, counts: np.ndarray) -> float:
        """Score of counts (row, col), any number type, counts."""
        c, s = as_numbers(counts), self.step
        if min(c.shape) <= 2 * s:
            return 0.0
        rows, twice = c[s:-s], 2 * c[s:-s, s:-s]
        across = np.abs(twice - rows[:, : -2 * s] - rows[:, 2 * s :])
        down = np.abs(twice - c[: -2 * s, s:-s] - c[2 * s :, s:-s])
        return float(across.sum() + down.sum()) / twice.size
