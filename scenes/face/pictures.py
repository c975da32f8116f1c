"""Reflectance pictures, float32 in 0..1, row 0 on top: skin, eye, hair, wool, wall paper, a framed print."""

from __future__ import annotations

import numpy as np
from sculpture import Features
from surfaces import cloudy, noise

SKIN_TEXEL_MM = 0.33  # a pixel sees 0.8 mm
TOP_MM, FOOT_MM, ROUND_MM = 124.0, -192.0, 480.0  # of the picture of the skin, wound round the axis


def unwound(vertices: np.ndarray) -> np.ndarray:
    """Coordinates (n, 2) on the picture of the skin, its seam behind."""
    turn = np.arctan2(vertices[:, 0], vertices[:, 2] + 6) / (2 * np.pi) + 0.5
    return np.stack([turn, (vertices[:, 1] - FOOT_MM) / (TOP_MM - FOOT_MM)], axis=1)


def skin(tone: float, hair: float, features: Features, random: np.random.Generator) -> np.ndarray:
    """Pores, blotches, freckles, moles, fine lines; darker lips, brows, lashes and stubble."""
    rows, columns = round((TOP_MM - FOOT_MM) / SKIN_TEXEL_MM), round(ROUND_MM / SKIN_TEXEL_MM)
    shape = rows, columns
    y = (TOP_MM - (np.arange(rows, dtype=np.float32) + 0.5) * SKIN_TEXEL_MM)[:, None]
    turn = ((np.arange(columns, dtype=np.float32) + 0.5) / columns - 0.5)[None, :] * 2 * np.pi
    x = 86 * np.sin(turn)  # mm across the face, seen from before
    front = np.cos(turn) > 0
    grey = tone * (1 + 0.07 * cloudy(shape, 14, 3, random))
    pores = noise(shape, (rows / 2.2, columns / 2.2), random)
    coarse = noise(shape, (rows / 5, columns / 5), random)
    grey *= 1 - 0.22 * np.clip(pores - 0.35, 0, 1) - 0.10 * np.clip(coarse, 0, 1)
    for _ in range(420):  # freckles and moles
        row, column = random.uniform(0, rows), random.uniform(0.15, 0.85) * columns
        size = random.uniform(0.5, 1.6)
        _blot(grey, (row, column), size / SKIN_TEXEL_MM, float(random.uniform(0.10, 0.45)))
    lines = np.sin(y * 2 * np.pi / 9 + 1.5 * noise(shape, (6, 9), random)) > 0.97
    grey *= 1 - 0.12 * (lines & (y > 34) & (np.abs(x) < 52) & front)  # of the forehead
    cheeks = np.exp(-(((np.abs(x) - 40) / 20) ** 2) - ((y + 28) / 18) ** 2) * front
    grey *= 1 - 0.13 * cheeks
    high = 8.6 * features.lips * (1 - 0.35 * np.abs(x) / 25)
    lips = ((x / 25) ** 2 + ((y + 68.5) / high) ** 2 < 1) & front
    creases = 1 - 0.25 * (noise(shape, (8, columns / 3), random) > 0.3)
    grey = np.where(lips, 0.62 * tone * creases, grey)
    eye = features.eye[0]
    for side in (-1, 1):
        across = (x - eye * side) * side  # outwards from the middle of the eye
        arch = 19 + 4.5 * np.sin((across + 17) / 40 * np.pi) - 0.004 * np.clip(across, 0, 40) ** 2
        brow = np.exp(-(((y - arch) / 3.4) ** 4)) * (across > -17) * (across < 24) * front
        strokes = noise(shape, (rows / 5, columns / 2.5), random) > -0.25
        grey += brow * strokes * (0.6 * hair - grey) * 0.9
        rim = ((across / 14.2) ** 2 + ((y + 0.4) / 6.2) ** 2 < 1) & front
        grey = np.where(rim, 0.5 * tone, grey)
        upper = np.exp(-(((y - 5.2 * np.sqrt(np.clip(1 - (across / 14.5) ** 2, 0, 1))) / 1.1) ** 2))
        grey += upper * (np.abs(across) < 14.5) * front * (0.05 - grey) * 0.85
    return np.clip(grey, 0.02, 0.75).astype(np.float32)


def _blot(grey: np.ndarray, middle: tuple[float, float], size: float, depth: float) -> None:
    """Darkens a soft round spot, in place."""
    reach = int(3 * size) + 1
    r0, c0 = int(middle[0]), int(middle[1])
    rows = slice(max(r0 - reach, 0), r0 + reach + 1)
    columns = slice(max(c0 - reach, 0), c0 + reach + 1)
    here = grey[rows, columns]
    if here.size:
        row, column = np.ogrid[: here.shape[0], : here.shape[1]]
        row, column = row + rows.start, column + columns.start
        here *= 1 - depth * np.exp(-((row - middle[0]) ** 2 + (column - middle[1]) ** 2) / (1.2 * size**2))


def eye(tone: float, random: np.random.Generator) -> np.ndarray:
    """An eyeball wound round the vertical, its pupil in the middle: white, a streaked iris, pupil."""
    n = 480
    lon = (np.arange(2 * n, dtype=np.float32) + 0.5)[None, :] / n * np.pi - np.pi
    lat = np.pi / 2 - (np.arange(n, dtype=np.float32) + 0.5)[:, None] / n * np.pi
    off = np.arccos(np.clip(np.cos(lat) * np.cos(lon), -1, 1))
    around = np.arctan2(np.sin(lat), np.sin(lon) * np.cos(lat))
    grey = 0.48 * (1 + 0.05 * cloudy((n, 2 * n), 40, 3, random))
    streaks = np.zeros_like(around)
    for wave in (17, 31, 53):
        streaks = streaks + np.sin(wave * around + random.uniform(0, 6) + 3 * off)
    iris = tone * (1 + 0.22 * streaks + 0.6 * np.exp(-(((off - 0.24) / 0.06) ** 2)))
    grey = np.where(off < 0.50, iris, grey)
    grey = np.where(np.abs(off - 0.48) < 0.05, 0.5 * tone, grey)
    return np.clip(np.where(off < 0.19, 0.02, grey), 0.015, 0.8).astype(np.float32)


def lock(tone: float, random: np.random.Generator) -> np.ndarray:
    """Strands along a lock, which is wound on u and long along v."""
    strands = noise((160, 96), (2.5, 48), random)
    return np.clip(tone * (1 + 0.55 * strands + 0.2 * noise((160, 96), (8, 30), random)), 0.012, 0.6)


def wool(tone: float, random: np.random.Generator) -> np.ndarray:
    """Stocking stitch: columns of slanted loops, 60 across and 44 down."""
    rows, columns = 880, 1200
    y, x = np.mgrid[0:rows, 0:columns].astype(np.float32)
    across, down = x / columns * 60, y / rows * 44
    slant = np.abs(np.mod(across, 1) - 0.5)
    loop = np.sin(2 * np.pi * (down + 0.9 * slant)) * 0.5 + 0.5
    body = np.clip(1.25 - 2.0 * np.abs(slant - 0.25), 0, 1)
    fluff = noise((rows, columns), (rows / 3, columns / 3), random)
    grey = tone * (0.30 + 0.9 * loop * body) * (1 + 0.18 * fluff)
    return np.clip(grey, 0.02, 0.8).astype(np.float32)


def paper(random: np.random.Generator) -> np.ndarray:
    """Wall paper: leafy stems in two tones; 2.4 m × 1.6 m."""
    rows, columns = 960, 1440
    y, x = np.mgrid[0:rows, 0:columns].astype(np.float32)
    grey = np.full((rows, columns), 0.34, dtype=np.float32)
    cell = 120
    u = np.mod(x, cell) - cell / 2
    v = np.mod(y + cell / 2 * (np.floor(x / cell) % 2), cell * 1.5) - cell * 0.75
    stem = np.abs(u - 9 * np.sin(v * 2 * np.pi / (cell * 1.5))) < 3
    grey[stem] = 0.20
    for k in range(6):
        for s in (-1, 1):
            du, dv = u - s * (20 + 6 * (k % 2)), v - (k - 2.5) * 28
            a, b = du * 0.8 * s + dv * 0.6, -du * 0.6 * s + dv * 0.8
            grey[(a / 22) ** 2 + (b / 8) ** 2 < 1] = 0.52 if k % 2 else 0.24
    return np.clip(grey * (1 + 0.04 * cloudy((rows, columns), 30, 3, random)), 0.05, 0.8).astype(np.float32)


def framed(random: np.random.Generator) -> np.ndarray:
    """A framed print of hills under a moon, in its mount."""
    rows, columns = 420, 320
    y, x = np.mgrid[0:rows, 0:columns].astype(np.float32)
    grey = np.full((rows, columns), 0.05, dtype=np.float32)
    inner = (np.abs(x - columns / 2) < 138) & (np.abs(y - rows / 2) < 188)
    grey[inner] = 0.72
    print_ = (np.abs(x - columns / 2) < 100) & (np.abs(y - rows / 2) < 140)
    grey[print_] = 0.50
    grey[print_ & (np.hypot(x - 200, y - 130) < 26)] = 0.75
    for k in range(5):
        top = 190 + 34 * k + 22 * np.sin(x * (0.02 + 0.006 * k) + random.uniform(0, 6))
        grey[print_ & (y > top)] = 0.38 - 0.075 * k
    return grey
