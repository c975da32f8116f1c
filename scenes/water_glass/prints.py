"""Enamel on the outside of a tumbler: opaque ink in two tones, cell by cell; millimetres."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from solids import Body
from stroke_font import drawn, lines

CELL_MM = 0.2  # a pixel sees 0.22 to 0.25 mm
HALF_MM, TOP_MM = 24.0, 62.0  # of the printed part, to both sides of the front, and up
WHITE, DARK = 0.74, 0.05
WORDS = ("AQUA", "FONTANA", "LIDO", "NEREID", "BRISA")


def enamel(
    design: str, radius: float, random: np.random.Generator
) -> tuple[Callable[[float, float, float], bool], Body]:
    """Whether there is ink within a distance of a place (along, up, distance), and the ink as a body."""
    x = (np.arange(round(2 * HALF_MM / CELL_MM)) + 0.5) * CELL_MM - HALF_MM
    y = (np.arange(round(TOP_MM / CELL_MM)) + 0.5) * CELL_MM
    tone = {"fish": _fish, "slices": _slices, "scale": _scale}[design](x, y, random)
    row, column = np.nonzero(tone > 0)
    along, up = x[column], y[row]

    def ink(a: float, h: float, distance: float) -> bool:
        return bool((np.hypot(along - a, up - h) < distance).any())

    corner = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * CELL_MM / 2
    angle = (along[:, None] + corner[:, 0]) / radius
    points = np.stack([radius * np.sin(angle), up[:, None] + corner[:, 1], radius * np.cos(angle)], axis=2)
    first = 4 * np.arange(len(row))[:, None]
    triangles = np.concatenate([first + np.array(half) for half in ((0, 1, 2), (0, 2, 3))])
    tones = np.repeat(tone[row, column], 4)
    return ink, Body(points.reshape(-1, 3), triangles, np.zeros((len(tones), 2)), tones)


def _fish(x: np.ndarray, y: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Three fish over a dark sea with lines of waves."""
    tone, px, py = np.zeros((y.size, x.size)), x[None, :], y[:, None]
    for k, high in enumerate((28.0, 25.0, 22.0, 19.0, 51.0)):
        wave = high + 1.1 * np.sin(2 * np.pi * px / 9 + 2.0 * k + random.uniform(0, 1))
        tone[(np.abs(py - wave) < (1.3 if high > 50 else 0.5)) & (np.abs(px) < 23)] = WHITE if k else DARK
        tone[(py < wave) & (py > 12) & (tone == 0) & (k == 0)] = DARK
    for k, (cx, cy) in enumerate(((-11.0, 42.5), (10.5, 43.5), (-1.5, 35.0))):
        side = -1 if k % 2 else 1
        u, v = side * (px - cx) / 8.2, (py - cy) / 3.4
        body = np.abs(v) < np.clip(1 - u**2, 0, None)
        tail = (u < -0.8) & (u > -1.35) & (np.abs(v) < -1.35 * (u + 0.72))
        fin = (np.abs(u + 0.1) < 0.4) & (v > 0.8) & (v < 1.5 - 0.9 * np.abs(u + 0.2))
        tone[body | tail | fin] = DARK
        scales = np.mod(np.hypot(np.mod(u * 8.2, 1.9) - 0.95, np.mod(v * 3.4, 1.5) - 0.75), 1.5)
        tone[body & (np.abs(u) < 0.62) & (np.abs(scales - 0.75) < 0.17)] = WHITE
        tone[tail & (np.mod(v * 4, 1) < 0.4)] = WHITE
        tone[body & (np.abs(u - 0.55) < 0.03)] = WHITE
        tone[np.hypot((u - 0.74) * 8.2, (v - 0.15) * 3.4) < 0.62] = WHITE
    return tone


def _slices(x: np.ndarray, y: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Slices of lemon: rind, pith, segments."""
    tone, px, py = np.zeros((y.size, x.size)), x[None, :], y[:, None]
    places = (
        (-13.5, 44, 8.2),
        (5.5, 48, 6.2),
        (17, 37, 6.6),
        (0.5, 32, 8.0),
        (-16, 26, 6.6),
        (14, 21, 7.6),
        (-3, 17, 6.0),
    )
    for cx, cy, size in places:
        r, turn = np.hypot(px - cx, py - cy) / size, np.arctan2(py - cy, px - cx) + random.uniform(0, 1)
        tone[r < 1] = DARK
        tone[r < 0.88] = WHITE
        part = np.abs(np.mod(turn / (2 * np.pi) * 9, 1) - 0.5) * 2 * np.pi / 9
        inner = (r > 0.14) & (r < 0.76) & (r * np.sin(np.pi / 9 - part) > 0.035)
        tone[inner] = DARK
        drop = np.mod(turn * 9 / (2 * np.pi) * 3, 1) < 0.22
        tone[inner & drop & (r > 0.4) & (r < 0.68)] = WHITE
    return tone


def _scale(x: np.ndarray, y: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A name, a rule of volume with its numbers, a border of lozenges."""
    tone = np.zeros((y.size, x.size))
    px, py = np.broadcast_arrays(x[None, :], y[:, None])
    name = str(random.choice(WORDS))
    word = lines(name, min(34 / len(name), 7.0), (2.0, 49.0))
    plaque = ((px - 2) / 21.5) ** 8 + ((py - 49) / 6.2) ** 8 < 1
    tone[plaque] = DARK
    tone[plaque & (((px - 2) / 20.7) ** 8 + ((py - 49) / 5.4) ** 8 > 1)] = WHITE
    tone[drawn(x, y, word, 1.3) > 0.5] = WHITE
    for k in range(17):
        high = 15 + 1.6 * k
        wide = 8.0 if k % 5 == 0 else 4.5
        tone[(np.abs(py - high) < 0.32) & (px > -21) & (px < -21 + wide)] = DARK
        if k % 5 == 0:
            number = lines(f"{k // 5 + 1}0", 3.4, (-8.5, high))
            tone[drawn(x, y, number, 1.7) > 0.5] = DARK
            tone[drawn(x, y, number, 0.75) > 0.5] = WHITE
    panel = (np.abs(px - 10.5) < 13) & (np.abs(py - 24.5) < 14)
    tone[panel] = DARK
    tone[panel & ((np.abs(px - 10.5) > 12) | (np.abs(py - 24.5) > 13))] = WHITE
    for k, high in enumerate((15.5, 24.5, 33.5)):
        lozenge = np.abs(np.mod(px + 4.0 * (k % 2), 8) - 4) / 3.4 + np.abs(py - high) / 3.8
        here = np.abs(px - 10.5) < 11
        tone[here & (lozenge < 1)] = WHITE
        tone[here & (lozenge < 0.55)] = DARK
    return tone
