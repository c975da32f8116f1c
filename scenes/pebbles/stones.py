"""Stones that water has rounded: their shape, and the minerals that are seen in them; millimetres."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from solids import Body, ball, placed, turning
from surfaces import cloudy

KINDS = ("granite", "gneiss", "basalt")
PICTURE = (620, 1040)  # rows from pole to pole, columns round: 0.08 mm of the large pebble
LARGE_MM = (9.0, 19.0, 13.0)  # the pebble that a picture is made for: its poles lie left and right
MICA, QUARTZ, FELDSPAR = 0.06, 0.34, 0.58


def stone(
    centre: Any,
    radii: Any,
    turn_deg: float,
    tilt_deg: float,
    random: np.random.Generator,
    *,
    steps: tuple[int, int] = (26, 40),
    fine: bool = False,
) -> Body:
    """A rounded stone, flat and long, its poles at the ends of its length; a fine one is rough as well."""
    rings, around = (200, 320) if fine else steps
    long, high, wide = (float(r) for r in radii)
    # The poles of a ball lie along y: it is made upright, and laid down.
    made = ball((0, 0, 0), (high, long, wide), rings=rings, around=around)
    shape = (rings + 1, around + 1)
    dents = 0.10 * cloudy(shape, 3, 2, random) + (0.006 * cloudy(shape, 50, 2, random) if fine else 0)
    dents = dents * np.sin(np.linspace(0, np.pi, rings + 1))[:, None] ** 0.7
    seam = np.minimum(np.linspace(0, 8, around + 1), 1)[None, :]  # the last column is the first again
    dents = seam * dents + (1 - seam) * dents[:, -1:]
    points = made.vertices * (1 + dents.reshape(-1, 1))
    pose = turning([0, 1, 0], turn_deg) @ turning([1, 0, 0], tilt_deg) @ turning([0, 0, 1], 90)
    return placed(made._replace(vertices=points), centre, turn=pose)


def picture(kind: str, random: np.random.Generator) -> np.ndarray:
    """Reflectances of a stone, float32 in 0..1: what a cut by its surface shows of the minerals inside."""
    points = _surface()
    if kind == "granite":
        grey = _granite(points, random)
    elif kind == "gneiss":
        grey = _gneiss(points, random)
    else:
        grey = _basalt(points, random)
    worn = 1 + 0.06 * cloudy(PICTURE, 6, 4, random)
    return np.clip(grey * worn, 0.03, 0.75)[::-1].astype(np.float32)


def _surface() -> np.ndarray:
    """Where on the large pebble each texel lies: (rows, columns, 3), millimetres."""
    latitude = np.pi * ((np.arange(PICTURE[0]) + 0.5) / PICTURE[0] - 0.5)[:, None]
    longitude = 2 * np.pi * ((np.arange(PICTURE[1]) + 0.5) / PICTURE[1] - 0.5)[None, :]
    ring = np.cos(latitude)
    unit = [ring * np.sin(longitude), np.sin(latitude) + 0 * longitude, ring * np.cos(longitude)]
    return np.stack(unit, axis=2) * LARGE_MM


def _grains(points: np.ndarray, size_mm: float, random: np.random.Generator) -> np.ndarray:
    """A number for every texel, alike within a grain: the nearest of random germs owns it."""
    half = np.array(LARGE_MM) + 2 * size_mm
    count = int(np.prod(2 * half) / size_mm**3)
    germs = cKDTree(random.uniform(-half, half, (count, 3)))
    return np.asarray(germs.query(points.reshape(-1, 3), workers=1)[1]).reshape(points.shape[:2])


def _granite(points: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Feldspar, quartz and mica in grains of 1.1 mm."""
    owner = _grains(points, 1.1, random)
    size = int(owner.max()) + 1
    tone = random.choice([FELDSPAR, QUARTZ, MICA], p=[0.52, 0.30, 0.18], size=size)
    return (tone * random.uniform(0.85, 1.15, size))[owner]


def _gneiss(points: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Light and dark bands, folded, of grains of 0.6 mm."""
    owner = _grains(points, 0.6, random)
    bend, axis = random.uniform(0, 2 * np.pi, 3), random.standard_normal(3)
    axis /= np.linalg.norm(axis)
    along = points @ axis + 1.3 * np.sin(points[..., 1] / 5 + bend[0]) + 0.8 * np.sin(points[..., 2] / 3 + bend[1])
    band = 0.5 + 0.5 * np.sin(2 * np.pi * along / 4.2) * np.cos(2 * np.pi * along / 11 + bend[2])
    light = random.uniform(0, 1, int(owner.max()) + 1)[owner] < 0.15 + 0.75 * band
    return np.where(light, 0.52, 0.10) * (1 + 0.2 * (random.uniform(-1, 1, int(owner.max()) + 1)[owner]))


def _basalt(points: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Dark and fine, with vesicles, crystals of olivine and a vein of calcite."""
    owner = _grains(points, 0.7, random)
    size = int(owner.max()) + 1
    tone = np.where(random.uniform(0, 1, size) < 0.07, 0.30, 0.12 * random.uniform(0.6, 1.4, size))
    tone = np.where(random.uniform(0, 1, size) < 0.05, 0.035, tone)
    axis = np.array([random.normal(0, 0.4), 1.0, random.normal(0, 0.4)])
    across = (
        points @ (axis / np.linalg.norm(axis)) + 0.9 * np.sin(points[..., 0] / 3) + 0.5 * np.sin(points[..., 2] / 2)
    )
    vein = np.abs(across - random.uniform(-7, 7)) < 0.7 + 0.3 * np.sin(points[..., 2])
    return np.where(vein, 0.62 + 0.06 * np.sin(9 * across), tone[owner])
