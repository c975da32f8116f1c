"""Noise in space, for bodies of any shape: smooth noise at points, and cells round scattered seeds.

Both take points (n, 3) in the unit of the scene, and a generator from which they draw, so that they repeat.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

NEXT_PART = 0.6  # of the strength of one octave, in the next


class Cells(NamedTuple):
    """The nearest seed of each point: its number (n,), the way from it (n, 3), the distance to the cell's wall (n,)."""

    number: np.ndarray
    away: np.ndarray
    wall: np.ndarray


def solid_noise(
    points: np.ndarray, size: float | tuple[float, float, float], random: np.random.Generator, *, octaves: int = 1
) -> np.ndarray:
    """Smooth value noise at points, float32 (n,), about -1..1.

    size : edge of the lattice's cells in the first octave, or one for each axis; each further octave is twice as
    fine and 0.6 times as strong.
    """
    total = np.zeros(len(points), dtype=np.float32)
    if not len(points):
        return total
    at = np.asarray(points, dtype=np.float32) / np.asarray(size, dtype=np.float32)
    for k in range(octaves):
        total += np.float32(NEXT_PART**k) * _value_noise(at * np.float32(2**k), random)
    return total


def _value_noise(at: np.ndarray, random: np.random.Generator) -> np.ndarray:
    at = at - at.min(axis=0) + random.uniform(0, 1, 3).astype(np.float32)
    first = at.astype(np.int32)
    part = at - first.astype(np.float32)
    part *= part * (3 - 2 * part)
    shape = first.max(axis=0) + 2
    lattice = random.uniform(-1, 1, shape).astype(np.float32).ravel()
    corner = (first[:, 0].astype(np.int64) * shape[1] + first[:, 1]) * shape[2] + first[:, 2]
    x, y, z = part.T
    planes = []
    for dx in (0, 1):
        rows = []
        for dy in (0, 1):
            here = corner + (dx * shape[1] + dy) * shape[2]
            rows.append(lattice[here] + z * (lattice[here + 1] - lattice[here]))
        planes.append(rows[0] + y * (rows[1] - rows[0]))
    return planes[0] + x * (planes[1] - planes[0])


def cells(points: np.ndarray, size: float, random: np.random.Generator) -> Cells:
    """Cells of about this size round scattered seeds (Worley 1996, doi:10.1145/237170.237267)."""
    low, high = points.min(axis=0) - size, points.max(axis=0) + size
    seeds = random.uniform(low, high, (int(np.prod((high - low) / size)) + 2, 3))
    distance, nearest = cKDTree(seeds).query(points, k=2)
    return Cells(nearest[:, 0], points - seeds[nearest[:, 0]], (distance[:, 1] - distance[:, 0]) / 2)
