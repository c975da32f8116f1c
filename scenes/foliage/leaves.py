"""Leaves: serrated blades with veins, of several ages and curls, thin enough to let light through.

A blade lies along +y from the stalk at the origin, its width along x, its face towards +z; it is 1 long.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
from meshes import Body, copies, joined, quads, texture

PICTURES = 8  # leaves of different age and wear, side by side
WIDE, HIGH = 112, 160  # texels of one: 0.33 mm of a leaf of 52 mm, a third of a pixel at the target
HALF_WIDTH = 0.34


def outline(t: np.ndarray) -> np.ndarray:
    """Half width of an apple's leaf at the share t of its length, without teeth."""
    return HALF_WIDTH * np.sin(np.pi * np.clip(t, 0, 1) ** 0.80) ** 0.85 * (1 - 0.25 * t) * 1.12


def blade(rows: int, columns: int, *, fold: float, curl: float, teeth: int = 0, wave: float = 0.0) -> Body:
    """One leaf as a grid of rows × columns; ``fold`` lifts its halves, ``curl`` bends it (radians)."""
    t = np.linspace(0, 1, rows)
    half = outline(t)
    if teeth:
        half = half * (1 - 0.09 * (teeth * t % 1.0)) * (t < 1)
    s = np.linspace(-1, 1, columns)
    x = half[:, None] * s
    z = fold * np.abs(x) + wave * np.sin(9 * t)[:, None] * s**2 * np.sign(s) * 0.12
    angle = curl * t
    step = np.diff(t, prepend=0)
    along, sunk = np.cumsum(step * np.cos(angle)), -np.cumsum(step * np.sin(angle))
    y = along[:, None] + np.sin(angle)[:, None] * z
    high = sunk[:, None] + np.cos(angle)[:, None] * z
    points = np.stack([x, y, high], axis=2)
    uv = np.stack([0.5 + x / (2 * HALF_WIDTH * 1.1), np.broadcast_to(t[:, None], x.shape)], axis=2)
    return Body(points.reshape(-1, 3), quads(rows, columns), uv.reshape(-1, 2))


def grown(places: np.ndarray, frames: np.ndarray, sizes: np.ndarray, random: np.random.Generator, *, fine: int) -> Body:
    """Leaves at these places, of a few shapes; ``fine``: 2 for the target, 1 around it, 0 far away."""
    rows, columns, teeth = ((4, 3, 0), (8, 5, 0), (43, 5, 14))[fine]
    shapes = [
        blade(rows, columns, fold=f, curl=c, teeth=teeth, wave=w)
        for f, c, w in ((0.25, 0.5, 0.3), (0.45, 0.9, 0.6), (0.10, 0.2, 0.8), (0.35, 1.3, 0.2), (0.2, -0.2, 0.5))
    ]
    which = random.integers(len(shapes), size=len(places))
    picture = random.integers(PICTURES, size=len(places))
    made = []
    for k, shape in enumerate(shapes):
        mine = np.flatnonzero(which == k)
        uv = np.tile(shape.uv, (len(mine), 1, 1))
        uv[:, :, 0] = (uv[:, :, 0] + picture[mine, None]) / PICTURES
        made.append(copies(shape, places[mine], frames[mine], sizes[mine], uv))
    return joined(made)


def skin(random: np.random.Generator, contrast: float) -> np.ndarray:
    """Colour (reflectance and transmittance together) of the leaves, row 0 at the stalk."""
    v, u = np.meshgrid(np.linspace(0, 1, HIGH), np.linspace(-1, 1, WIDE), indexing="ij")
    x = u * HALF_WIDTH * 1.1
    rows = []
    for k in range(PICTURES):
        tone = (0.20, 0.24, 0.27, 0.22, 0.30, 0.25, 0.18, 0.33)[k]
        picture = np.full((HIGH, WIDE), tone, dtype=np.float64)
        # Side veins leave the midrib at 50 degrees and bend towards the tip.
        phase = (v - 0.95 * np.abs(x) - 0.5 * x**2) * 9 + 0.15 * (k % 3)
        vein = np.exp(-(((phase % 1) - 0.5) ** 2) / 0.004)
        cells = np.sin(70 * v + 31 * x + k) * np.sin(64 * x - 23 * v + 2 * k)
        picture *= 1 + contrast * (0.55 * vein + 0.14 * cells - 0.25 * np.exp(-((phase % 1 - 0.2) ** 2) / 0.02))
        picture[np.abs(x) < 0.012 * (1.3 - v)] = 0.48
        picture *= 1 - contrast * 0.35 * np.clip(np.abs(x) / np.maximum(outline(v), 1e-3) - 0.86, 0, 0.14) / 0.14
        for _ in range(int(random.integers(2, 12))):  # rust and bites
            r = np.hypot(v - random.uniform(0.1, 0.9), (x - random.uniform(-0.25, 0.25)))
            picture[r < random.uniform(0.008, 0.035)] *= 1 - 0.7 * contrast
        rows.append(picture)
    return np.clip(np.concatenate(rows, axis=1), 0.02, 0.8).astype(np.float32)


def tissue(picture: np.ndarray, *, through: float, roughness: float = 0.45) -> Any:
    """A thin sheet, loaded: of what it does not absorb, the share through/2 leaves at the other side."""
    return mi.load_dict(
        {
            "type": "principledthin",
            "base_color": texture(picture),
            "diff_trans": through,
            "spec_trans": 0.0,
            "roughness": roughness,
            "eta": 1.42,
        }
    )
