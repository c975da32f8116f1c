"""Pictures of metal, float32 in 0..1, row 0 on top: what finish and years leave of its reflectance."""

from __future__ import annotations

import numpy as np
from surfaces import cloudy, noise

TEXEL_MM = 0.09  # a pixel sees 0.25 mm to 0.29 mm


def turned_face(half_mm: float, tarnish: float, random: np.random.Generator) -> np.ndarray:
    """A wheel's face seen along its axis: rings of the lathe, tarnish, scratches, old oil."""
    axis = ((np.arange(round(2 * half_mm / TEXEL_MM)) + 0.5) * TEXEL_MM - half_mm).astype(np.float32)
    x, y = axis[None, :], axis[::-1, None]
    shape = axis.size, axis.size
    radius = np.hypot(x, y)
    marks = random.uniform(-1, 1, axis.size).astype(np.float32)
    rings = np.interp(radius.ravel() / (1.5 * half_mm) * axis.size, np.arange(axis.size), marks).reshape(shape)
    grey = 1 - 0.14 * (1 + rings) - 0.12 * (1 + cloudy(shape, half_mm, 4, random))
    stains = np.clip(cloudy(shape, 0.5 * half_mm, 5, random) - 0.25, 0, 1)
    grey *= 1 - tarnish * np.clip(1.4 * stains, 0, 0.75)
    specks = cloudy(shape, 1.6 * half_mm, 2, random) > 1.12
    grey *= np.where(specks, 1 - 0.75 * tarnish, 1)
    grey *= 1 - 0.45 * tarnish * np.exp(-(((radius - 0.30 * half_mm) / (0.06 * half_mm)) ** 2))
    for _ in range(round(2.4 * half_mm)):
        at, turn = random.uniform(-half_mm, half_mm, 2), random.uniform(0, np.pi)
        along = (x - at[0]) * np.cos(turn) + (y - at[1]) * np.sin(turn)
        off = (y - at[1]) * np.cos(turn) - (x - at[0]) * np.sin(turn)
        line = (np.abs(off) < 0.09) & (np.abs(along) < random.uniform(0.7, 0.35 * half_mm))
        grey[line] *= random.uniform(0.35, 0.8)
    return np.clip(grey, 0.05, 1).astype(np.float32)


def pearled(width_mm: float, height_mm: float, random: np.random.Generator) -> np.ndarray:
    """A plate ground in overlapping spots, rows of 5 mm."""
    texel = 0.15
    x = ((np.arange(round(width_mm / texel)) + 0.5) * texel).astype(np.float32)[None, :]
    y = ((np.arange(round(height_mm / texel)) + 0.5) * texel).astype(np.float32)[:, None]
    step = 3.6
    grey = np.zeros((y.size, x.size), dtype=np.float32)
    for row in (0, 1):  # the later row lies over the earlier one
        u = np.mod(x + 0.5 * step * row, step) - 0.5 * step
        v = np.mod(y, 2 * step) - step * (0.5 + row)
        r, turn = np.hypot(u, v), np.arctan2(v, u)
        spot = 0.66 + 0.16 * np.sin(2 * turn) + 0.10 * np.sin(9 * r)
        grey = np.where(r < 0.62 * step, spot, grey)
    grey = np.where(grey == 0, 0.6, grey)
    shape = grey.shape
    grey *= 1 + 0.12 * cloudy(shape, 14, 5, random) + 0.06 * noise(shape, (shape[0] / 2, shape[1] / 2), random)
    return np.clip(grey, 0.05, 1).astype(np.float32)


def brushed(shape: tuple[int, int], tarnish: float, random: np.random.Generator) -> np.ndarray:
    """Steel brushed across the picture, with spots of rust."""
    lines = noise(shape, (shape[0] / 1.5, shape[1] / 60), random)
    grey = 0.85 * (1 + 0.12 * lines) * (1 - 0.5 * tarnish * (cloudy(shape, 18, 4, random) > 0.9))
    return np.clip(grey, 0.05, 1).astype(np.float32)
