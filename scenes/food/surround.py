"""The board with its scars and flour, and the linen beside it; millimetres, the board is y = 0."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
from solids import box, grid
from surfaces import cloudy, glossy, matte, mesh, noise, texture

BOARD_MM, NEAR_MM, TEXEL_MM = (260.0, 215.0), 95.0, 0.12
THICK_MM, LINEN_MM = 18.0, 300.0


def table(floured: tuple[float, float], flour: float, random: np.random.Generator) -> dict[str, Any]:
    """The board, its edge, and a cloth on the table behind it; flour lies round x, z."""
    wide, near, far = BOARD_MM[0] / 2, NEAR_MM, NEAR_MM - BOARD_MM[1]
    flat = grid([[(-wide, 0, near), (wide, 0, near)], [(-wide, 0, far), (wide, 0, far)]])
    grey, high = _wood(floured, flour, random)
    bumped = {"type": "bumpmap", "height": texture(high), "bsdf": glossy(texture(grey), 0.38)["bsdf"]}
    wood = {"type": "twosided", "bsdf": bumped}
    edge = box((-wide, -THICK_MM, far), (wide, -0.05, far + 4), tone=0.15)
    return {
        "board": mesh("board", flat, wood, smooth=False),
        "edge": mesh("edge", edge, matte(0.14), smooth=False),
        "linen": _linen(random),
    }


def _wood(floured: tuple[float, float], flour: float, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Reflectance and height (parts of the board) of worn beech, its grain across; row 0 is the far side."""
    columns, rows = (round(side / TEXEL_MM) for side in BOARD_MM)
    shape = rows, columns
    y = (np.arange(rows, dtype=np.float32) * TEXEL_MM)[:, None]
    bend = noise(shape, (6, 2), random) + 0.25 * noise(shape, (24, 5), random)
    at = y / 6.5 + 1.3 * bend
    ring = at - np.floor(at)
    fibre = noise(shape, (rows / 2.2, columns / 70), random)
    pores = np.clip(noise(shape, (rows / 2.5, columns / 26), random) - 0.5, 0, 1) * 2.0
    grey = 0.25 * (1.2 - 0.62 * ring**2.5) * (1 + 0.16 * fibre + 0.12 * cloudy(shape, 5, 3, random))
    grey *= 1 - 0.6 * pores
    stain = np.clip(1.8 * cloudy(shape, 5, 4, random) - 0.5, 0, 1)
    grey *= 1 - 0.40 * stain
    high = 0.03 * fibre - 0.08 * pores
    for k in range(420):
        cx, cy = random.uniform(0, columns), random.uniform(0, rows)
        a = random.normal(0.5, 0.3) if k % 4 else random.normal(-0.6, 0.5)
        half = random.lognormal(np.log(120), 0.6)
        t = np.arange(-half, half, 0.5)
        bow = random.normal(0, 0.0003) * t**2
        column, row = cx + t * np.cos(a) - bow * np.sin(a), cy + t * np.sin(a) + bow * np.cos(a)
        deep = random.lognormal(np.log(0.5), 0.6) * np.clip(3 * (1 - np.abs(t) / half), 0, 1)
        for side, dark, dip in ((0, 0.85, 0.30), (1, 0.6, 0.22), (2, -0.40, -0.05), (-1, -0.15, -0.02)):
            r, c = (row + side).astype(int), column.astype(int)
            inside = (c >= 0) & (c < columns) & (r >= 0) & (r < rows)
            r, c, d = r[inside], c[inside], np.minimum(deep[inside], 1)
            grey[r, c] *= 1 - dark * d
            high[r, c] -= dip * d
    x = (np.arange(columns, dtype=np.float32) * TEXEL_MM - BOARD_MM[0] / 2)[None, :]
    z = y + NEAR_MM - BOARD_MM[1]
    away = np.hypot(x - floured[0], z - floured[1]) / 34.0
    dust = cloudy(shape, 9, 4, random) + 0.9 * noise(shape, (rows / 2.2, columns / 2.2), random) - 1.35 * away
    thick = np.clip(1.1 * dust + 1.3 * flour - 0.35, 0, 1) * (
        0.55 + 0.45 * noise(shape, (rows / 1.5, columns / 1.5), random)
    )
    grey += np.clip(thick, 0, 1) * (0.70 - grey)
    return np.clip(grey, 0.03, 0.7).astype(np.float32), (high / BOARD_MM[0]).astype(np.float32)


def _linen(random: np.random.Generator) -> mi.Mesh:
    """A cloth in low folds: plain weave of uneven threads of 0.6 mm, a darker stripe."""
    n = 140
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, n), np.linspace(0, 1, n), indexing="xy")
    fold = np.sin(9 * u + 4 * v + random.uniform(0, 6)) + 0.6 * np.sin(17 * u - 9 * v + random.uniform(0, 6))
    folds = np.clip(fold + 0.4 * noise((n, n), (5, 5), random), -0.2, 2)
    points = np.stack([460 * u, 7 * folds - THICK_MM, -90 - 330 * v], axis=2)
    size, threads = 1500, 500
    at = np.arange(size) / size * threads
    k = at.astype(int)
    over = ((k[:, None] + k[None, :]) % 2).astype(bool)
    warp, weft = (1 + 0.2 * random.standard_normal(threads) for _ in range(2))
    tone = np.where(over, warp[k][None, :], weft[k][:, None]) * np.where(np.abs(at % 1 - 0.5) > 0.35, 0.6, 1)[:, None]
    tone = tone * np.where(np.abs(np.arange(size) % 375 - 180)[None, :] < 22, 0.45, 1.0)
    return mesh("linen", grid(points), matte(texture(np.clip(0.42 * tone, 0.03, 0.7))))
