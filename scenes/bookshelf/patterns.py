"""Grey reflectances of shelf and globe, float32 in 0..1, and the noise of all surfaces; row 0 is the top."""

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


def cloudy(shape: Shape, cells: float, octaves: int, random: np.random.Generator) -> np.ndarray:
    """Octaves of noise, each twice as fine and half as strong, about -1..1; cells across the first one."""
    high = cells * shape[0] / shape[1]
    layers = (noise(shape, (high * 2**k, cells * 2**k), random) * 0.5**k for k in range(octaves))
    return sum(layers, np.zeros(shape, np.float32))


def wood(shape: Shape, rings: float, mean: float, random: np.random.Generator) -> np.ndarray:
    """Stained oak, its grain running across the picture."""
    bent = noise(shape, (1.5, 5), random) + 0.3 * noise(shape, (3, 13), random)
    ring = np.arange(shape[0], dtype=np.float32)[:, None] * (rings / shape[0]) + 0.16 * rings * bent
    late = (ring - np.floor(ring)) ** 3
    pores = noise(shape, (shape[0] / 3, shape[1] / 40), random)
    grey = mean * (1.12 - 0.5 * late + 0.18 * pores - 0.3 * (pores > 0.7))
    return np.clip(grey, 0.03, 0.9).astype(np.float32)


def globe(shape: Shape, random: np.random.Generator) -> np.ndarray:
    """An atlas globe: invented continents with coast lines and relief, dark sea, a net of meridians."""
    height, width = shape
    lattice = cloudy((height, width), 5, 5, random)
    # The two ends of the sheet meet at the date line.
    share = np.clip((np.arange(width) / width - 0.85) / 0.15, 0, 1).astype(np.float32)
    land = (lattice * (1 - share) + lattice[:, ::-1] * share) - 0.08
    coast = np.abs(land) < 0.045
    grey = np.where(land > 0, 0.50 + 0.22 * np.clip(land, 0, 1), 0.20 - 0.06 * np.clip(land, -1, 0))
    grey[coast] = 0.07
    row, column = np.arange(height)[:, None] / height * 12, np.arange(width) / width * 24
    net = (np.abs(row - np.round(row)) < 0.03) | (np.abs(column - np.round(column)) < 0.035)
    return np.where(net & ~coast, 0.62 * grey + 0.2, grey).astype(np.float32)
