"""Reflectance pictures, float32 in 0..1, row 0 on top: the crust of a roll, the board."""

from __future__ import annotations

import numpy as np
from surfaces import cloudy, noise

CUT_U = 0.67  # where the cut lies, round the roll
BOARD_MM, BOARD_TEXEL_MM = (360.0, 420.0), 0.2


def crust(flour: float, random: np.random.Generator) -> np.ndarray:
    """Round the roll, from pole to pole: baked crust with blisters and cracks, a pale torn cut, flour."""
    shape = rows, columns = 760, 1300  # 0.09 mm by 0.11 mm
    u = ((np.arange(columns) + 0.5) / columns)[None, :]
    v = ((np.arange(rows) + 0.5) / rows)[:, None]
    baked = np.clip(0.5 + 0.45 * cloudy(shape, 5, 5, random), 0, 1)
    grey = 0.09 + 0.17 * baked
    cracks = np.abs(cloudy(shape, 34, 2, random)) < 0.045 * np.clip(0.6 + cloudy(shape, 5, 2, random), 0, 1)
    grey[cracks] = 0.36
    blisters = np.clip((cloudy(shape, 70, 2, random) - 0.65) * 5, 0, 1)
    grey *= 1 - 0.35 * blisters
    along = np.abs(v - 0.5) * 2
    ragged = 0.036 + 0.016 * cloudy((rows, 40), 1.4, 2, random)[:, :1]
    torn = (np.abs(u - CUT_U) < ragged) & (along < 0.66)
    crumb = 0.46 * (1 + 0.28 * cloudy(shape, 60, 3, random))
    grey[torn] = crumb[torn]
    dust = cloudy(shape, 7, 3, random) + 0.7 * noise(shape, (rows / 2.5, columns / 2.5), random)
    thick = np.clip((dust - 1.0 + 1.1 * flour) * 0.9, 0, 1) * np.clip(1.4 - along, 0, 1) * ~torn
    grey += 0.85 * thick * (0.70 - grey)
    return np.clip(grey, 0.03, 0.8)[::-1].astype(np.float32)


def board(random: np.random.Generator) -> np.ndarray:
    """Oak, its grain across, with knife marks."""
    columns, rows = (round(side / BOARD_TEXEL_MM) for side in BOARD_MM)
    shape = rows, columns
    y = np.broadcast_to((np.arange(rows, dtype=np.float32) * BOARD_TEXEL_MM)[:, None], shape)
    bend = noise(shape, (8, 3), random) + 0.3 * noise(shape, (30, 8), random)
    rings = np.mod(y / 6.5 + 1.6 * bend, 1)
    grey = 0.21 * (1.15 - 0.5 * rings**3) * (1 + 0.18 * noise(shape, (rows / 2, columns / 30), random))
    grey *= 1 + 0.12 * cloudy(shape, 8, 3, random)
    for _ in range(70):
        cx, cy, a = random.uniform(0, columns), random.uniform(0, rows), random.normal(0.5, 0.6)
        at = np.linspace(-1, 1, 800) * random.uniform(40, 220)
        column, row = (cx + at * np.cos(a)).astype(int), (cy + at * np.sin(a)).astype(int)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        grey[row[inside], column[inside]] *= random.uniform(0.5, 0.8)
    return np.clip(grey, 0.03, 0.5).astype(np.float32)
