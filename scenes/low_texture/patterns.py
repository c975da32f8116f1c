"""Weak grain of unfired clay, egg shell and paper: patterns of mean 0 and SD 1, float32, row 0 at the top."""

from __future__ import annotations

import numpy as np

Shape = tuple[int, int]


def noise(shape: Shape, cells: tuple[float, float], random: np.random.Generator) -> np.ndarray:
    """Value noise in -1..1 with so many lattice cells down and across."""
    lattice = random.uniform(-1, 1, [int(n) + 2 for n in cells]).astype(np.float32)
    for axis in (0, 1):
        at = np.arange(shape[axis], dtype=np.float32) * np.float32(cells[axis] / shape[axis])
        first = at.astype(np.int64)
        part = at - first
        part *= part * (3 - 2 * part)
        part = part[:, None] if axis == 0 else part
        here = np.take(lattice, first, axis=axis)
        lattice = here + part * (np.take(lattice, first + 1, axis=axis) - here)
    return lattice


def clay(shape: Shape, texel_mm: float, grain_mm: float, random: np.random.Generator) -> np.ndarray:
    """Grog in the clay, the potter's finger rings, and faint clouds of the firing."""
    rows, columns = shape
    high, wide = rows * texel_mm / grain_mm, columns * texel_mm / grain_mm
    grain = noise(shape, (high, wide), random) + 0.7 * noise(shape, (high / 2.1, wide / 2.1), random)
    specks = np.clip(noise(shape, (high / 1.2, wide / 1.2), random) - 0.6, 0, 1)
    rings = noise((rows, 8), (high / 1.4, 1.0), random)[:, np.arange(columns) * 8 // columns]
    clouds = noise(shape, (high / 14, wide / 14), random)
    return _standard(grain + 0.45 * rings - 3.0 * specks + 0.3 * clouds)


def shell(shape: Shape, cells: float, random: np.random.Generator) -> np.ndarray:
    """Pores of an egg shell, over a faint mottle."""
    pores = np.clip(noise(shape, (cells, 1.5 * cells), random) - 0.35, 0, 1)
    return _standard(0.6 * noise(shape, (cells / 2, 0.75 * cells), random) - 2.0 * pores)


def paper(shape: Shape, cells: float, random: np.random.Generator) -> np.ndarray:
    """Tooth of a matt paper, and broad clouds in its tone."""
    high = cells * shape[0] / shape[1]
    tooth = noise(shape, (high, cells), random) + 0.6 * noise(shape, (high / 3, cells / 3), random)
    return _standard(tooth + 0.5 * noise(shape, (high / 40, cells / 40), random))


def _standard(pattern: np.ndarray) -> np.ndarray:
    return ((pattern - pattern.mean()) / pattern.std()).astype(np.float32)
