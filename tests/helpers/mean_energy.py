"""Energies of pictures, by which the grain of stacks is checked."""

import numpy as np

from saf_gen.stack.grain import filter_grain


def mean_energy(first: np.ndarray, second: np.ndarray, *, energy: str) -> float:
    """Return the mean product of two pictures (row, col) after the filters of an energy, one of ENERGIES.

    If both are the same picture, this is the focus measure of that name (``variance`` for ``contrast``). For two
    renders with independent noise, it estimates the measure of the noise-free picture.
    """
    mask = np.ones(first.shape, bool)
    pairs = zip(filter_grain(first, energy, mask=mask), filter_grain(second, energy, mask=mask), strict=True)
    return float(sum((a * b).mean() for (a, _), (b, _) in pairs))
