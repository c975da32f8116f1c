"""What is inside crystals: sheets of twins, cleavages, strain, from which every grain samples its piece."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from rasters import fractal, noise, splat, strokes
from scipy.ndimage import distance_transform_edt, gaussian_filter

SIDE = 768  # texels of a sheet


class Sheets(NamedTuple):
    """Twin lamellae and short spindles (0 or 1, soft edges), cleavage lines, distance from cracks (texels),
    strain, subgrains, stringers, speckle."""

    twins: np.ndarray
    spindles: np.ndarray
    cleavage: np.ndarray
    cracks: np.ndarray
    strain: np.ndarray
    subgrains: np.ndarray
    stringers: np.ndarray
    speckle: np.ndarray


def sheets(random: np.random.Generator) -> Sheets:
    """Lamellae, lines and stringers run along the columns."""
    shape = SIDE, SIDE
    n = 1500
    rows, columns, which = strokes(
        random.uniform(0, SIDE, (n, 2)),
        random.normal(0, 0.008, n),
        np.exp(random.normal(4.1, 0.7, n)),
        bend=random.normal(0, 0.0004, n),
    )
    lines = splat(shape, rows % SIDE, columns % SIDE, random.uniform(0.25, 1.0, n)[which], blur=0.6)
    broad = noise(shape, (90, 220), random) + 0.6 * noise(shape, (34, 110), random)
    cells = noise(shape, (44, 90), random) + 0.3 * noise(shape, 9, random)
    ridge = noise(shape, (9, 60), random) + 0.5 * noise(shape, (4, 22), random)
    return Sheets(
        _lamellae(150, (1.4, 0.8), (5.2, 0.8), random),
        _lamellae(2200, (0.75, 0.35), (3.3, 0.5), random),
        np.clip(1.5 * lines, 0, 1),
        _cracks(random),
        broad,
        gaussian_filter(np.round(2.5 * cells) / 2.5, 0.8),
        np.clip((ridge - 0.55) / 0.15 + 0.5, 0, 1),
        fractal(shape, 3.2, 2, random),
    )


def _lamellae(
    count: int, wide: tuple[float, float], long: tuple[float, float], random: np.random.Generator
) -> np.ndarray:
    """Lamellae that taper and end; where two overlap the crystal is the first one again.

    wide, long : of the half width and half length, mean and spread of the logarithm of texels.
    """
    sheet = np.zeros((SIDE, SIDE), dtype=np.float32)
    half = np.exp(random.normal(*wide, count))
    reach = np.exp(random.normal(*long, count)).clip(8, 0.49 * SIDE)
    for k in range(count):
        middle, at = random.uniform(0, SIDE, 2)
        r, c = np.arange(-int(half[k]) - 2, int(half[k]) + 3), np.arange(-int(reach[k]), int(reach[k]) + 1)
        taper = np.sqrt(np.clip(1 - np.abs(c / reach[k]) ** 6, 0, 1))  # even, then a blunt end
        if half[k] < 3:
            taper = 1 - np.abs(c / reach[k]) ** 2
        rows, columns = np.floor(middle) + r, (np.floor(at) + c).astype(int) % SIDE
        drawn = np.clip(half[k] * taper - np.abs(rows - middle)[:, None] + 0.5, 0, 1).astype(np.float32)
        here = np.ix_(rows.astype(int) % SIDE, columns)
        sheet[here] += drawn - 2 * sheet[here] * drawn
    return sheet


def _cracks(random: np.random.Generator) -> np.ndarray:
    """Distance (texels) from cracks that wander across the crystal in two directions; some are forked."""
    n, steps = 120, 420
    free = np.ones((SIDE, SIDE), dtype=bool)
    heading = np.where(random.random(n) < 0.6, 0.2, 1.7) + random.normal(0, 0.35, n)
    turning = gaussian_filter(random.normal(0, 1, (n, steps)), (0, 14)) + 0.5 * gaussian_filter(
        random.normal(0, 1, (n, steps)), (0, 4)
    )
    angle = heading[:, None] + 3.2 * turning
    rows, columns = np.cumsum(0.8 * np.sin(angle), axis=1), np.cumsum(0.8 * np.cos(angle), axis=1)
    start = random.uniform(0, SIDE, (n, 2))
    for k in range(40, n, 3):  # a fork begins on another crack
        at = random.integers(steps)
        start[k] = start[k - 40] + (rows[k - 40, at], columns[k - 40, at])
    length = random.integers(50, steps, n)
    kept = np.arange(steps) < length[:, None]
    rows, columns = (a + start[:, k : k + 1] for k, a in enumerate((rows, columns)))
    free[np.round(rows[kept]).astype(int) % SIDE, np.round(columns[kept]).astype(int) % SIDE] = False
    distance = distance_transform_edt(free).astype(np.float32)
    return gaussian_filter(np.minimum(distance, 60), 0.6)
