"""Mid-frequency DCT on separate tiles, as in the released code of Su et al."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.plugins.measures._counts import as_integers

V = (1, 1, -1, -1)
M = np.array([[V[i - j] if 0 <= i - j < 4 else 0 for j in range(4)] for i in range(7)])
"""7×4 matrix of the full convolution of four numbers with v, so that O * tile is M·tile·Mᵀ for O = vvᵀ."""
ENERGY = np.kron(M.T @ M, M.T @ M)
"""Matrix of Σ(M tile Mᵀ)² as a quadratic form of the tile's 16 numbers."""


@dataclass(frozen=True)
class MidFrequencyDctTiles:
    """Σ(O * tile)² over 4×4 tiles, each fully convolved (7×7) with O = vvᵀ, v = (1, 1, −1, −1).

    Rows and columns beyond the last complete tile are left out. Because of the border of zeros around each tile, the
    score depends on brightness: a constant tile of counts c scores 144c², whereas the method of Lee et al. gives 0.

    Range from 0, in squared counts; degree 2; cost 32: 16 multiplications and as many additions per pixel.

    References
    ----------
    .. [1] Released code of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363.
    .. [2] Lee et al., IEEE TCSVT 18(9), 2008, doi:10.1109/TCSVT.2008.924105.
    """

    degree: ClassVar[int] = 2
    cost: ClassVar[float] = 32.0
    score_range: ClassVar[str] = "from 0; 144 c^2 a tile for constant counts c"

    def __call__(self, counts: np.ndarray) -> float:
        """Return the score of counts (row, col) of any number type, 0.0 if no tile fits into the image."""
        c = as_integers(counts)
        rows, cols = (n // 4 * 4 for n in c.shape)
        if not (rows and cols):
            return 0.0
        tiles = c[:rows, :cols].reshape(rows // 4, 4, cols // 4, 4).transpose(1, 3, 0, 2).reshape(16, -1)
        # One matrix product for all tiles, in float64 because integer products are slow. Products of whole
        # numbers from as_integers are exact in float64.
        x = tiles.astype(np.float64)
        return float((ENERGY * (x @ x.T).astype(c.dtype)).sum())
