"""Reflectance pictures, float32 in 0..1, row 0 on top: skin of a hand seen along z, wool, wall paper."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from sculpture import HIGH, LOW, Hand
from strokes import drawn
from surfaces import cloudy, noise

TEXEL_MM = 0.35  # a pixel sees 0.7 mm
PALM_LINES = (
    ((18, 84), (6, 76), (-4, 62), (-8, 44), (-5, 24), (2, 8)),  # round the ball of the thumb
    ((30, 74), (14, 72), (-4, 64), (-22, 54), (-32, 46)),
    ((14, 88), (2, 80), (-14, 74), (-30, 70), (-40, 68)),
    ((2, 70), (-1, 50), (3, 30), (4, 12)),
    ((-16, 4), (0, 1), (18, 5)),
    ((-18, -3), (0, -6), (20, -3)),
)


def seen(vertices: np.ndarray) -> np.ndarray:
    """Coordinates (n, 2) on a picture of the skin: it is laid on along z."""
    return (vertices[:, :2] - LOW[:2]) / (np.array(HIGH[:2]) - LOW[:2])


def skin(tone: float, hand: Hand, side: str, random: np.random.Generator) -> np.ndarray:
    """Palm (paler, lines) or back (tendons' shade, veins, nails), with creases at the joints."""
    x = np.arange(LOW[0], HIGH[0], TEXEL_MM) + TEXEL_MM / 2
    y = np.arange(LOW[1], HIGH[1], TEXEL_MM) + TEXEL_MM / 2
    shape = rows, columns = y.size, x.size
    grey = np.ones(shape, dtype=np.float32) + 0.08 * cloudy(shape, 9, 3, random)
    net = np.abs(noise(shape, (rows / 7, columns / 7), random))
    net = np.minimum(net, np.abs(noise(shape, (rows / 9, columns / 5), random)))
    grey *= 1 - 0.16 * np.clip(1 - 7 * net, 0, 1)  # the net of fine furrows
    grey *= 1 + 0.07 * noise(shape, (rows / 2.5, columns / 2.5), random)
    lines, fine = [], []
    for points, radii in hand.fingers:
        for k in (1, 2):
            lines += _across(points, radii, k, (0.0, 1.8) if side == "palm" else (0.0,), random)
            fine += _across(points, radii, k, (-4.5, -2.5, -1.2, 1.4, 3, 5), random)
        lines += _across(points, radii, 0, (radii[0] * 1.2,), random) if side == "palm" else []
    if side == "palm":
        for curve in PALM_LINES:
            bent = np.asarray(curve, dtype=float) + random.normal(0, 1.2, (len(curve), 2))
            lines += list(pairwise(bent))
        for _ in range(90):
            at, way = random.uniform((-38, 4), (36, 92)), random.normal(0, 3.5, 2)
            fine.append((at, at + way))
    else:
        for _ in range(7):  # veins
            at = random.uniform((-28, 18), (24, 40))
            bent = at + np.cumsum(random.normal((0, 9), (3, 2), (6, 2)), axis=0)
            grey *= 1 - 0.10 * drawn(x, y, list(pairwise(bent)), 2.6)
    grey *= 1 - 0.30 * drawn(x, y, lines, 0.9)
    grey *= 1 - 0.16 * drawn(x, y, fine, 0.5)
    if side == "back":
        _nails(grey, x, y, hand)
    ground = tone if side == "back" else max(tone, 0.45 * tone + 0.20)  # palms are paler
    return np.clip(ground * grey[::-1], 0.03, 0.75)


def _across(
    points: np.ndarray, radii: np.ndarray, k: int, places: tuple[float, ...], random: np.random.Generator
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Creases across a finger at its joint k, so many mm along it."""
    way = (points[k + 1] - points[max(k - 1, 0)])[:2]
    way = way / max(np.linalg.norm(way), 1e-6)
    aside = np.array([way[1], -way[0]])
    made = []
    for place in places:
        middle = points[k, :2] + way * (place + random.normal(0, 0.3))
        half = radii[k] * random.uniform(0.6, 0.95) * aside
        bow = middle + way * random.normal(0, 0.5)
        made += [(middle - half, bow), (bow, middle + half)]
    return made


def _nails(grey: np.ndarray, x: np.ndarray, y: np.ndarray, hand: Hand) -> None:
    """Nails, where the last bone is not bent out of sight: pale, a paler moon, a dark rim; in place."""
    for points, radii in hand.fingers:
        way = points[3] - points[2]
        if way[1] < 0.7 * np.linalg.norm(way):
            continue
        way = way[:2] / np.linalg.norm(way[:2])
        px, py = x[None, :] - points[3, 0] + 0.5 * way[0], y[:, None] - points[3, 1] + 0.5 * way[1]
        along, across = px * way[0] + py * way[1], px * way[1] - py * way[0]
        off = (np.abs(along) / 7.0) ** 3 + (np.abs(across) / (0.86 * radii[3])) ** 3
        grey[(off < 1.25) & (off >= 1)] *= 0.55
        grey[off < 1] = 1.18
        grey[(off < 1) & (np.hypot(along + 8.0, across) < 4)] = 1.4
        grey[(off < 1) & (along > 5)] = 1.5


def wool(tone: float, random: np.random.Generator) -> np.ndarray:
    """Ribbed knitting: columns of slanted loops, 40 across and 60 down."""
    rows, columns = 960, 800
    y, x = np.mgrid[0:rows, 0:columns].astype(np.float32)
    across, down = x / columns * 40, y / rows * 60
    slant = np.abs(np.mod(across, 1) - 0.5)
    loop = np.sin(2 * np.pi * (down + 0.9 * slant)) * 0.5 + 0.5
    body = np.clip(1.25 - 2.0 * np.abs(slant - 0.25), 0, 1) * (0.7 + 0.3 * (np.mod(across, 4) < 2))
    grey = tone * (0.3 + 0.9 * loop * body) * (1 + 0.18 * noise((rows, columns), (320, 270), random))
    return np.clip(grey, 0.02, 0.8)


def paper(random: np.random.Generator) -> np.ndarray:
    """Striped wall paper with small sprigs; 2.4 m × 1.6 m."""
    rows, columns = 800, 1200
    y, x = np.mgrid[0:rows, 0:columns].astype(np.float32)
    grey = np.where(np.mod(x, 100) < 50, np.float32(0.30), np.float32(0.24))
    u, v = np.mod(x, 100) - 25, np.mod(y + 40 * (np.floor(x / 100) % 2), 80) - 40
    for k in range(5):
        a = k * 2 * np.pi / 5
        petal = np.hypot(u - 9 * np.cos(a), v - 9 * np.sin(a)) < 5.5
        grey[petal] = 0.48
    grey[np.hypot(u, v) < 4] = 0.12
    return np.clip(grey * (1 + 0.05 * cloudy((rows, columns), 20, 3, random)), 0.05, 0.7)
