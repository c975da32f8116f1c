"""Newspaper as a reflectance, float32, row 0 on top: how a press lays ink on rough paper, and the paper."""

from __future__ import annotations

import numpy as np
from surfaces import cloudy, noise

TEXEL_MM = 0.045  # a pixel sees 0.14 mm
SPREAD_MM = 0.035  # by which ink runs beyond the type
FIBRES_PER_MM2, FIBRE_MM = 2.2, (0.5, 2.4)


def screened(grey: np.ndarray, *, dots_per_mm: float, angle_deg: float) -> np.ndarray:
    """Ink of a picture of tones (0 dark, 1 bright) as round dots on a square screen, which meet half way."""
    y, x = np.ogrid[0 : grey.shape[0], 0 : grey.shape[1]]
    a, k = np.radians(angle_deg), 2 * np.pi * dots_per_mm * TEXEL_MM
    u, v = k * (np.cos(a) * x + np.sin(a) * y), k * (np.cos(a) * y - np.sin(a) * x)
    spot = (np.cos(u) + np.cos(v)).astype(np.float32) / 2  # -1..1; its distribution is symmetric about 0
    share = 0.5 + 0.5 * np.sign(spot) * (1 - (1 - np.abs(spot)) ** 1.4)  # about even over 0..1
    return np.clip((share - np.clip(grey, 0.05, 0.95)) * 3.5 / k + 0.5, 0, 1)


def enlarged(picture: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """A picture with more pixels, linear in between."""
    for axis, count in enumerate(shape):
        at = np.clip((np.arange(count) + 0.5) * picture.shape[axis] / count - 0.5, 0, picture.shape[axis] - 1.001)
        first = at.astype(int)
        part = (at - first)[:, None] if axis == 0 else at - first
        here = np.take(picture, first, axis=axis)
        picture = here + part * (np.take(picture, first + 1, axis=axis) - here)
    return picture.astype(np.float32)


def blurred(picture: np.ndarray, radius: int) -> np.ndarray:
    """A mean over squares of 2·radius + 1 texels, twice in a row; the rim goes on."""
    for axis in (0, 1, 0, 1):
        padded = np.pad(picture, [(radius + 1, radius) if k == axis else (0, 0) for k in (0, 1)], mode="edge")
        total = np.cumsum(padded, axis=axis, dtype=np.float64)
        width = 2 * radius + 1
        ends = [np.take(total, np.arange(k, k + picture.shape[axis]), axis=axis) for k in (width, 0)]
        picture = ((ends[0] - ends[1]) / width).astype(np.float32)
    return picture


def printed(
    cover: np.ndarray, other_side: np.ndarray, tones: tuple[float, float], random: np.random.Generator
) -> np.ndarray:
    """Reflectance of a page with this ink (0..1); ``tones`` are those of the paper and of solid ink.

    The ink runs along fibres, lies thinner in the middle of solids than at their rim, and misses pits.
    """
    shape = cover.shape
    fine = noise(shape, (shape[0] / 1.7, shape[1] / 1.7), random)
    rough = 0.6 * noise(shape, (shape[0] / 4, shape[1] / 4), random) + 0.4 * fine
    soft = blurred(cover, 1)
    gain = SPREAD_MM / (2 * TEXEL_MM) * 0.5
    ink = np.clip((soft + gain + 0.16 * rough - 0.34) / 0.42, 0, 1)
    pits = np.clip((noise(shape, (shape[0] / 3, shape[1] / 3), random) - 0.62) / 0.2, 0, 1)
    rim = np.clip((blurred(cover, 4) - 0.6) / 0.4, 0, 1)  # the middle of solids
    ink *= (1 - 0.7 * pits * (0.4 + 0.6 * rim)) * (0.99 - 0.05 * rim + 0.03 * rough)
    ink *= 1 + 0.07 * np.clip(cloudy(shape, 3, 2, random), -1, 0.1)  # rollers are never even
    through = blurred(blurred(np.ascontiguousarray(other_side[:, ::-1]), 5), 3)
    ground = tones[0] * paper(shape, random) * (1 - 0.085 * through)
    return np.clip(ground + np.clip(ink, 0, 1) * (tones[1] * (1 + 0.15 * fine) - ground), 0.02, 0.85).astype(np.float32)


def paper(shape: tuple[int, int], random: np.random.Generator) -> np.ndarray:
    """Mechanical paper, relative to its mean: clouds, single fibres, specks of old print and of wood."""
    sheet = 1 + 0.030 * cloudy(shape, shape[1] * TEXEL_MM / 5, 5, random)
    sheet += 0.022 * noise(shape, (shape[0] / 1.5, shape[1] / 2.5), random)
    area = shape[0] * shape[1] * TEXEL_MM**2
    for count, depth, spread in ((int(FIBRES_PER_MM2 * area), 0.045, 1.0), (int(0.03 * area), -0.22, 0.35)):
        sheet += _fibres(shape, count, depth, spread, random)
    specks = noise(shape, (shape[0] / 3.5, shape[1] / 3.5), random)
    return sheet - 0.30 * np.clip((specks - 0.86) / 0.08, 0, 1)


def _fibres(shape: tuple[int, int], count: int, depth: float, spread: float, random: np.random.Generator) -> np.ndarray:
    """Bent hairs of one texel, brighter or darker by up to ``depth``, most of them up and down."""
    steps = 64
    length = random.uniform(*FIBRE_MM, count) * spread / TEXEL_MM
    turn = np.pi / 2 + random.normal(0, 0.7, count)
    along = (np.arange(steps) / steps)[None, :] * length[:, None]
    bend = random.normal(0, 1.2, count) / np.maximum(length, 1)
    angle = turn[:, None] + bend[:, None] * along
    step = length[:, None] / steps
    x = random.uniform(0, shape[1], count)[:, None] + np.cumsum(np.cos(angle), axis=1) * step
    y = random.uniform(0, shape[0], count)[:, None] + np.cumsum(np.sin(angle), axis=1) * step
    weight = (depth * random.uniform(-0.4, 1, count))[:, None] * np.minimum(step, 1) + np.zeros_like(x)
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    inside = (column >= 0) & (column < shape[1] - 1) & (row >= 0) & (row < shape[0])
    part = (x - column)[inside]
    place, weight = (row * shape[1] + column)[inside], weight[inside]
    size = shape[0] * shape[1]
    total = np.bincount(place, weight * (1 - part), size) + np.bincount(place + 1, weight * part, size)
    return np.clip(total, -0.3, 0.12).reshape(shape).astype(np.float32)
