"""Energy of a tile's cosine transform over that of its mean."""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.measures._counts import as_floats

SIDE = 8
MOST = 2 * (SIDE - 1)


@dataclass(frozen=True)
class DctEnergyRatio:
    """Mean over 8x8 tiles of Σ F(u,v)² / F(0,0)², F the cosine transform, u + v of 1 to ``highest_order``.

    With all orders (14) it is the squared contrast of a tile, by Parseval: spike dispersion at home. The five
    lowest (``highest_order`` 2) are the reduced energy ratio of Lee et al., which leaves out most noise. Each
    tile is divided by its own brightness, so dark tiles with few spikes weigh most; a tile without a spike
    counts as 0. Rows and columns beyond the last whole tile are left out; 0.0 where not one tile fits.

    Range 0 ... 63, degree 0, cost 130: two a pixel for each of 63 waves, and four; 12 for order 2.
    """

    highest_order: int = MOST

    degree: ClassVar[int] = 0
    source: ClassVar[str] = (
        "Shen and Chen, Robust focus measure for low-contrast images, ICCE 2006, as DCTE of Pertuz et al., "
        "Pattern Recognition 46(5), 2013, doi:10.1016/j.patcog.2012.11.011; order 2: Lee et al., IEEE Signal "
        "Processing Letters 16(2), 2009, doi:10.1109/LSP.2008.2008938"
    )
    score_range: ClassVar[str] = "0 ... 63; 0 for constant counts"

    def __post_init__(self) -> None:
        order = self.highest_order
        if isinstance(order, bool) or not isinstance(order, int) or not 1 <= order <= MOST:
            raise BadInput(f"highest_order is {order!r}", allowed=f"a whole number, 1 to {MOST}")

    @property
    def cost(self) -> float:
        """Additions and multiplications a pixel."""
        waves = len(_waves(self.highest_order))
        return 2 * waves * (1 + 1 / SIDE**2) + 2

    def __call__(self, counts: np.ndarray) -> float:
        """Score of counts (row, col), any number type."""
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


@lru_cache(maxsize=MOST)
def _waves(highest_order: int) -> np.ndarray:
    """The orthonormal cosine waves of a tile but for the constant one: (waves, 64)."""
    k = np.arange(SIDE)
    wave = np.sqrt(2 / SIDE) * np.cos(np.pi * np.outer(k, 2 * k + 1) / (2 * SIDE))
    wave[0] = np.sqrt(1 / SIDE)
    order = np.add.outer(k, k).ravel()
    return np.kron(wave, wave)[(order > 0) & (order <= highest_order)]
