"""A street on a dull day: sky, houses and a wet road as one picture that shines, lit shops before it."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
from surfaces import cloudy, noise

AWAY_M, SIZE_M, TEXEL_M = 110.0, (440.0, 320.0), 0.2
ROAD_Y, ROOF_Y = -6.5, 12.0  # where houses stand; mean height of their eaves
STOREY_M, BAY_M = 3.0, 1.9  # from window to window, up and across
LIT = 7


def street(sky: float, random: np.random.Generator) -> dict[str, Any]:
    """The picture, and the lit shop windows, signs and lamps in front of it."""
    t = mi.ScalarTransform4f()
    scene = {"street": _shining(t.translate([0, 0, -AWAY_M]), SIZE_M, _texture(_picture(sky, random)), seldom=True)}
    places = np.linspace(-16.0, 16.0, LIT) + random.uniform(-1.2, 1.2, LIT)
    for k, x in enumerate(places):
        high = k % 3 == 1  # a lit sign over the road; else a shop's window
        size = (1.8, 0.7) if high else (float(random.uniform(2.4, 3.6)), float(random.uniform(1.8, 2.3)))
        y = random.uniform(-0.5, 1.5) if high else ROAD_Y + 0.5 + size[1] / 2
        radiance = 0.8 if high else _goods(float(random.uniform(0.5, 0.8)), random)
        value = radiance if high else _texture(radiance)
        scene[f"lit_{k}"] = _shining(t.translate([x, y, 2.0 - AWAY_M]), size, value)
    return scene


def paint(shape: tuple[int, int], random: np.random.Generator) -> np.ndarray:
    """White paint on wood, with brush strokes, cracks and dirt."""
    strokes = noise(shape, (shape[0] / 70, shape[1] / 2.5), random)
    cracks = np.abs(noise(shape, (shape[0] / 60, shape[1] / 5), random)) < 0.03
    grey = 0.62 * (1 + 0.07 * strokes + 0.08 * cloudy(shape, 2, 5, random))
    return np.clip(np.where(cracks, 0.5 * grey, grey), 0.05, 0.85)


def _picture(sky: float, random: np.random.Generator) -> np.ndarray:
    """Radiance (W m^-2 sr^-1), row 0 on top."""
    wide, high = (round(side / TEXEL_M) for side in SIZE_M)
    y = (SIZE_M[1] / 2 - (np.arange(high) + 0.5) * TEXEL_M)[:, None]
    x = ((np.arange(wide) + 0.5) * TEXEL_M - SIZE_M[0] / 2)[None, :]
    clouds = cloudy((high, wide), 24, 5, random)
    picture = sky * (1.1 - 0.02 * np.clip(y / 10, 0, 16) + 0.22 * clouds)
    left = -SIZE_M[0] / 2
    while left < SIZE_M[0] / 2:
        right = left + random.uniform(6.0, 10.0)
        eaves = ROOF_Y + random.uniform(-2.0, 3.0)
        house = (x >= left) & (x < right) & (y < eaves) & (y > ROAD_Y)
        wall = sky * random.uniform(0.34, 0.46) * (1 + 0.15 * clouds)
        picture = np.where(house, wall, picture)
        peak = eaves + 0.6 * (right - left) / 2 - 0.6 * np.abs(x - (left + right) / 2)
        picture = np.where(
            (x >= left) & (x < right) & (y >= eaves) & (y < peak), sky * random.uniform(0.15, 0.22), picture
        )
        across = np.abs((x - left) / BAY_M % 1 - 0.5) < 0.22
        up = np.abs((y - ROAD_Y) / STOREY_M % 1 - 0.55) < 0.26
        pane = house & across & up & (y > ROAD_Y + 3.2) & (y < eaves - 0.3)
        storey = ((y - ROAD_Y) / STOREY_M).astype(int), ((x - left) / BAY_M).clip(0, 9).astype(int)
        glow = random.choice([0.12, 0.18, 0.6, 0.9], (40, 10), p=[0.45, 0.35, 0.12, 0.08])
        picture = np.where(pane, sky * glow[storey[0].clip(0, 39), storey[1]], picture)
        left = right
    road = sky * (0.30 - 0.16 * np.clip((ROAD_Y - y) / 40, 0, 1)) * (1 + 0.25 * clouds)
    wet = picture[::-1][: high // 3].mean(axis=0)[None, :]
    return np.where(y > ROAD_Y, picture, road + 0.15 * wet).clip(0.002)


def _goods(level: float, random: np.random.Generator) -> np.ndarray:
    """A shop's window: lit shelves with things in the way."""
    shape = (48, 48)
    picture = level * (1 + 0.3 * cloudy(shape, 4, 3, random))
    for row in (14, 30):
        picture[row : row + 2] *= 0.3
        for _ in range(9):
            column, wide, tall = random.integers(0, 44), random.integers(2, 5), random.integers(4, 11)
            picture[row - tall : row, column : column + wide] *= random.uniform(0.2, 0.8)
    return picture


def _texture(values: np.ndarray) -> dict[str, Any]:
    rows = np.ascontiguousarray(values[::-1], dtype=np.float32)  # a bitmap begins at v = 0
    return {"type": "bitmap", "bitmap": mi.Bitmap(rows), "raw": True, "wrap_mode": "clamp"}


def _shining(pose: Any, size: tuple[float, float], radiance: Any, *, seldom: bool = False) -> dict[str, Any]:
    emitter: dict[str, Any] = {"type": "area", "radiance": radiance}
    if seldom:
        emitter["sampling_weight"] = 0.1  # chance finds it often enough
    return {
        "type": "rectangle",
        "to_world": pose @ mi.ScalarTransform4f().scale([size[0] / 2, size[1] / 2, 1]),
        "bsdf": {"type": "diffuse", "reflectance": 0.0},
        "emitter": emitter,
    }
