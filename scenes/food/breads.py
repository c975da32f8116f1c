"""Half a crusty loaf, cut open: a field with thousands of pores, meshed; millimetres, it stands on y = 0."""

from __future__ import annotations

import numpy as np
from clay import Clay
from solid_noise import cells, solid_noise
from solids import Body

HALF_MM, HIGH_MM, LONG_MM = 32.0, 25.0, 52.0  # half width, half height, length of the half loaf
MIDDLE_MM = 19.0  # height of the widest place: the foot is flat
SCORE_MM, LIP_MM = 3.0, 3.6  # where the score runs across the top, and how high its lip stands
TORN_MM = 15.0  # width of what the score has opened
DEEP_MM = (7.0, 4.0)  # how far behind the cut small pores lie, and large ones
CRUMB, CRUST, FLOUR = 0.66, 0.15, 0.72


def loaf(cell: float, flour: float, random: np.random.Generator) -> Body:
    """The cut is the plane z = 0 and looks to +z; the crust with its score and its lip lies behind it."""
    clay = Clay((-36.0, -1.0, -39.0), (36.0, 50.0, 1.2), cell=cell)
    x, y, z = np.meshgrid(*clay.axes, indexing="ij", sparse=True)
    clay.field = np.maximum(_outer(x, y, z), z).astype(np.float32)
    _pores(clay, cell, random)
    points, triangles = clay.mesh()
    points = points + 0.55 * np.stack([solid_noise(points, 5.0, random, octaves=2) for _ in range(3)], axis=1)
    depth = -_outer(*points.T)
    points, tone = _skin(points, depth, flour, random)
    uv = np.stack([points[:, 0] + 0.55 * points[:, 2], points[:, 1] - 0.45 * points[:, 2]], axis=1) / 20.0
    return Body(points, triangles, uv, tone)


def _across(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Millimetres to the right of the lip, which leans over what it has opened."""
    return x + SCORE_MM + 1.3 * np.sin(z / 6.0) - 0.35 * (y - 40.0)


def _on_top(y: np.ndarray) -> np.ndarray:
    share = np.clip((y - 27.0) / 9.0, 0, 1)
    return share * share * (3 - 2 * share)


def _outer(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Distance to the crust, roughly: negative inside, as if the loaf had not been cut."""
    q = np.abs(x / HALF_MM) ** 2.3 + np.abs((y - MIDDLE_MM) / HIGH_MM) ** 2.3
    q = q + np.abs(np.minimum(z, 0) / LONG_MM) ** 2.6
    s = _across(x, y, z)
    opened = np.clip(s / TORN_MM, 0, 1)
    lift = np.where(s < 0, LIP_MM * np.exp(np.minimum(s, 0) / 5.0), -1.8 * (1 - opened) ** 1.5)
    away = (q ** (1 / 2.3) - 1) * 26.0 - lift * _on_top(y)
    foot = 0.6 - y
    return np.maximum(away, foot) + 0.8 * np.exp(-((away - foot) ** 2) / 6.0)


def _pores(clay: Clay, cell: float, random: np.random.Generator) -> None:
    """Bubbles near the cut: a few large ones, drawn out along the crust, and ever more small ones."""
    for count, size, spread, blend in ((42, 2.1, 0.30, 0.5), (800, 0.95, 0.35, 0.3), (5200, 0.42, 0.25, 0.12)):
        radius = size * random.lognormal(0, spread, count)
        place = random.uniform((-31, 2, -DEEP_MM[size > 2]), (31, 43, 0.3), (count, 3))
        deep = -_outer(*place.T)
        for r, centre, inside in zip(radius, place, deep, strict=True):
            if inside < 1.3 * r + 0.9 or r < 1.2 * cell:
                continue
            angle = np.arctan2(centre[0] * HIGH_MM, -(centre[1] - MIDDLE_MM) * HALF_MM) + random.normal(0, 0.5)
            c, s = np.cos(angle), np.sin(angle)
            turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
            shape = r * np.array([random.uniform(1.0, 1.9), random.uniform(0.65, 1.0), random.uniform(0.8, 1.3)])
            clay.ball(centre, shape, blend=blend, turn=turn, cut=True)


def _skin(
    points: np.ndarray, depth: np.ndarray, flour: float, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Roughen the crust, and give every vertex its reflectance."""
    x, y, z = points.T
    cut = np.clip(z / 0.8 + 1.4, 0, 1)  # 1 on the cut
    crust = np.clip(1.15 - depth / 0.9, 0, 1) * (1 - cut)
    s = _across(x, y, z)
    torn = np.clip(1.5 - np.abs(s / TORN_MM - 0.5) * 3.0, 0, 1) * _on_top(y) * (1 - cut)
    broad, fine = solid_noise(points, 9.0, random, octaves=4), solid_noise(points, 1.4, random, octaves=3)
    streaks = solid_noise(points, (5.0, 2.0, 0.8), random, octaves=3)
    blister = np.clip(solid_noise(points, 1.9, random, octaves=2) - 0.25, 0, 1)
    crack = cells(points + 0.5 * fine[:, None], 4.5, random).wall
    cracked = np.exp(-((crack / 0.16) ** 2)) * crust * (1 - torn) * (solid_noise(points, 8.0, random) > -0.1)
    baked = CRUST * (1.0 + 0.55 * broad + 0.20 * fine) * (1 - 0.5 * blister)
    lip = np.exp(-((s / 1.3) ** 2)) * _on_top(y)
    baked = baked * (1 - 0.65 * lip) + 0.20 * cracked
    opened = 0.33 * (1 + 0.55 * streaks + 0.25 * broad) * np.clip(1.25 - 0.5 * lip, 0.4, 1.3)
    skin = baked + torn * (opened - baked)
    rings = np.sin(2 * np.pi * (np.hypot(x, z + 4) + 0.8 * fine) / 6.0)  # of the basket in which it rose
    dust = np.clip(0.55 * rings + 0.8 * broad + 0.75 * fine - 0.75 + 1.25 * flour, 0, 1)
    dust = dust * np.clip((y - 4) / 14, 0, 1) * np.clip(1 - 0.8 * torn - lip, 0, 1) * crust
    skin = skin + 0.85 * dust * (FLOUR - skin)
    inner = np.clip((depth - 0.5) / 2.2, 0, 1) ** 0.6
    crumb = CRUMB * (1 + 0.07 * broad + 0.08 * fine) * (0.36 + 0.64 * inner)
    crumb = np.where(depth < 0.7, 0.5 * crumb, crumb)
    tone = crumb + crust * (skin - crumb)
    lift = crust * (0.30 * fine + 0.45 * blister - 0.35 * cracked + torn * (0.9 * streaks) + 0.22 * dust)
    lift = lift + 0.10 * fine * (1 - crust)
    away = points - np.array([0, MIDDLE_MM, -10.0])
    away = away * [1 / HALF_MM, 1 / HIGH_MM, 0.6 / LONG_MM]
    away = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-6)
    tone = tone * (1 + 0.06 * random.standard_normal(len(points)))
    return points + lift[:, None] * away, np.clip(tone, 0.02, 0.82)
