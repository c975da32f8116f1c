"""Energy ratio of the cosine transform: that of a tile's details, divided by the energy of its mean."""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_floats
from saf_gen.plugins.measures._options import check_whole_number

SIDE = 8
MAX_ORDER = 2 * (SIDE - 1)


@dataclass(frozen=True)
class DctEnergyRatio:
    """Mean over 8×8 tiles of Σ F(u,v)² / F(0,0)², with F the cosine transform and u + v from 1 to ``highest_order``.

    With all orders, up to 14, this is the mean squared contrast of the tiles, by Parseval's theorem. With orders up to
    2, the five lowest frequencies, it is the reduced energy ratio of Lee et al., which leaves out most noise. Each tile
    is divided by its brightness, so dark tiles with few spikes weigh most; a tile without a spike scores 0. Rows and
    columns beyond the last complete tile are left out. The score is 0.0 if no tile fits into the image.

    Range 0 to 63; degree 0; cost 130: two operations per pixel for each of 63 waves, plus four (12 in all for
    order 2).

    References
    ----------
    .. [1] Shen and Chen, ICCE 2006; DCTE in Pertuz et al., "Analysis of focus measure operators for
       shape-from-focus", Pattern Recognition 46(5), 2013, doi:10.1016/j.patcog.2012.11.011.
    .. [2] Order 2: Lee et al., IEEE Signal Processing Letters 16(2), 2009, doi:10.1109/LSP.2008.2008938.
    """

    highest_order: int = MAX_ORDER

    degree: ClassVar[int] = 0
    score_range: ClassVar[str] = "0 ... 63; 0 for constant counts"

    def __post_init__(self) -> None:
        check_whole_number("highest_order", self.highest_order, highest=MAX_ORDER)

    @property
    def cost(self) -> float:
        """Additions and multiplications per pixel."""
        waves = len(_waves(self.highest_order))
        return 2 * waves * (1 + 1 / SIDE**2) + 2

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type."""
        c = as_floats(counts)
        rows, cols = (n // SIDE * SIDE for n in c.shape)
        if not (rows and cols):
            return 0.0
        split = c[:rows, :cols].reshape(rows // SIDE, SIDE, cols // SIDE, SIDE)
        tiles = split.transpose(1, 3, 0, 2).reshape(SIDE**2, -1)
        mean = tiles.mean(axis=0)
        kept = np.square(_waves(self.highest_order) @ (tiles - mean)).sum(axis=0)
        whole = np.square(SIDE * mean)
        return float(np.divide(kept, whole, out=np.zeros_like(kept), where=whole > 0).mean())


@lru_cache(maxsize=MAX_ORDER)
def _waves(highest_order: int) -> np.ndarray:
    """Return the orthonormal cosine waves of a tile except the constant one, (waves, 64)."""
    k = np.arange(SIDE)
    wave = np.sqrt(2 / SIDE) * np.cos(np.pi * np.outer(k, 2 * k + 1) / (2 * SIDE))
    wave[0] = np.sqrt(1 / SIDE)
    order = np.add.outer(k, k).ravel()
    return np.kron(wave, wave)[(order > 0) & (order <= highest_order)]
