"""Sum-modified Laplacian: second differences whose signs cannot cancel."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers
from saf_gen.plugins.measures._options import check_whole_number


@dataclass(frozen=True)
class ModifiedLaplacian:
    """Mean of |2c − c(x−s) − c(x+s)| + |2c − c(y−s) − c(y+s)| with s = ``step``, without a threshold.

    The magnitude is taken along each axis, because in the Laplacian the two second differences may cancel. Ramps score
    0. The magnitudes of noise add up, so pictures with few counts score high. The score is 0.0 for fewer than 2s + 1
    rows or columns, and never rises when a periodic scene is blurred further.

    Range from 0, in counts; degree 1; cost 7: six additions and a multiplication per pixel.

    References
    ----------
    Nayar and Nakagawa, "Shape from focus", IEEE TPAMI 16(8), 1994, doi:10.1109/34.308479.
    """

    step: int = 1

    degree: ClassVar[int] = 1
    cost: ClassVar[float] = 7.0
    score_range: ClassVar[str] = "from 0; 0 for constant counts and ramps"

    def __post_init__(self) -> None:
        check_whole_number("step", self.step, unit="number of pixels")

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type, in counts."""
        c, s = as_integers(counts), self.step
        if min(c.shape) <= 2 * s:
            return 0.0
        rows, twice = c[s:-s], 2 * c[s:-s, s:-s]
        across = np.abs(twice - rows[:, : -2 * s] - rows[:, 2 * s :])
        down = np.abs(twice - c[: -2 * s, s:-s] - c[2 * s :, s:-s])
        return float(across.sum() + down.sum()) / twice.size
