"""What is struck: heights (mm) of a coin's face over its disc: rim, beads, legend and one of four motifs.

Raised lines are round in section; bodies are domes over their outline. Coordinates in mm, y up.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from solids import rounded
from stroke_font import lines

RADIUS = 12.0
RIM, BEADS, LEGEND_R, FIELD_R = 0.42, 72, 9.35, 7.7
LEGENDS = (
    "COMMONWEALTH OF THE ISLES", "FREE PORT OF HALVARD", "REPUBLIC OF THE VALLEYS", "CONFEDERATION OF RIVERS",
)  # fmt: skip
VALUES = ("5 CROWNS", "20 MARKS", "1 FLORIN", "50 CENTS", "2 DUCATS")
Pieces = list[tuple[np.ndarray, np.ndarray]]


def face(x: np.ndarray, y: np.ndarray, motif: str, random: np.random.Generator) -> np.ndarray:
    """Heights at points (any shape) of the disc: the field is 0, slightly dished."""
    r, turn = np.hypot(x, y), np.arctan2(x, y)
    height = 0.05 * (r / RADIUS) ** 2
    height = np.maximum(height, RIM * _step((r - 10.95) / 0.25) * (1 - 0.5 * _step((r - 11.75) / 0.22)))
    bead = np.mod(turn / (2 * np.pi) * BEADS, 1) - 0.5
    off = np.hypot(bead * 2 * np.pi * 10.55 / BEADS, r - 10.55)
    height = np.maximum(height, 0.26 * np.sqrt(np.clip(1 - (off / 0.36) ** 2, 0, None)))
    pieces = _round_the_rim(str(random.choice(LEGENDS)), up=True)
    pieces += _round_the_rim(f"{random.choice(VALUES)}  {int(random.integers(1843, 1990))}", up=False)
    height = np.maximum(height, 0.24 * _lines(x, y, pieces, 0.42))
    drawing = {"ship": _ship, "tree": _tree, "rose": _rose, "fish": _fish}[motif]
    return np.maximum(height, drawing(x / 1.08, y / 1.08, random))


def _step(at: np.ndarray) -> np.ndarray:
    t = np.clip(at, 0, 1)
    return t * t * (3 - 2 * t)


def _lines(x: np.ndarray, y: np.ndarray, pieces: Pieces, width: float) -> np.ndarray:
    """Straight pieces, 1 high, with a round section of this width."""
    height = np.zeros_like(x)
    for start, stop in pieces:
        low, high = np.minimum(start, stop) - width, np.maximum(start, stop) + width
        near = (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])
        px, py = x[near] - start[0], y[near] - start[1]
        dx, dy = stop - start
        along = np.clip((px * dx + py * dy) / max(dx * dx + dy * dy, 1e-12), 0, 1)
        off = np.hypot(px - along * dx, py - along * dy) / (width / 2)
        height[near] = np.maximum(height[near], np.sqrt(np.clip(1 - off**2, 0, None)))
    return height


def _curve(x: np.ndarray, y: np.ndarray, knots: Any, width: float) -> np.ndarray:
    return _lines(x, y, list(pairwise(rounded(knots, steps=6))), width)


def _body(x: np.ndarray, y: np.ndarray, knots: Any, *, edge: float) -> np.ndarray:
    """A closed outline through knots, filled: 0 on it, 1 from ``edge`` (mm) inwards, rounded between."""
    outline = rounded([*knots, knots[0]], steps=6)
    low, high = outline.min(axis=0), outline.max(axis=0)
    near = (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])
    height = np.zeros_like(x)
    x, y = x[near], y[near]
    inside, nearest = np.zeros(x.shape, dtype=bool), np.full(x.shape, 1e3)
    for (x0, y0), (x1, y1) in pairwise(outline):
        crosses = (y0 > y) != (y1 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            inside ^= crosses & (x < (x1 - x0) * (y - y0) / (y1 - y0) + x0)
        dx, dy = x1 - x0, y1 - y0
        along = np.clip(((x - x0) * dx + (y - y0) * dy) / max(dx * dx + dy * dy, 1e-12), 0, 1)
        nearest = np.minimum(nearest, np.hypot(x - x0 - along * dx, y - y0 - along * dy))
    depth = np.clip(nearest / edge, 0, 1)
    height[near] = np.where(inside, np.sqrt(depth * (2 - depth)), 0)
    return height


def _round_the_rim(text: str, *, up: bool) -> Pieces:
    """Letters with their feet to the middle, over the top; or with their heads to it, along the bottom."""
    step = 1.42 / LEGEND_R
    made = []
    for place, letter in enumerate(text):
        angle = (place - (len(text) - 1) / 2) * step  # clockwise from the top
        for start, stop in lines(letter, 1.25, (0.0, 0.0)):
            moved = []
            for point in (start, stop):
                if up:
                    a, radius = angle, LEGEND_R + point[1]
                    a += point[0] / LEGEND_R
                else:
                    a, radius = np.pi - angle, LEGEND_R - point[1]
                    a -= point[0] / LEGEND_R
                moved.append(np.array([radius * np.sin(a), radius * np.cos(a)]))
            made.append((moved[0], moved[1]))
    return made


def _ship(x: np.ndarray, y: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A three-masted ship before the wind, on waves."""
    hull = [(-5.2, -1.7), (-4.9, -3.4), (-3.4, -4.3), (2.6, -4.4), (4.6, -3.2), (5.6, -1.2), (3.2, -2.1), (-2.4, -2.2)]
    height = 0.34 * _body(x, y, hull, edge=0.9)
    for k in range(3):
        height += 0.035 * _curve(x, y, [(-4.6, -2.8 - 0.45 * k), (0, -3.2 - 0.4 * k), (4.8, -2.4 - 0.5 * k)], 0.16)
    for mast, tall in ((-3.2, 4.4), (0.2, 6.0), (3.2, 4.2)):
        height = np.maximum(height, 0.22 * _lines(x, y, [(np.array([mast, -2.2]), np.array([mast, tall + 0.5]))], 0.24))
        for k, (low, high) in enumerate(((0.0, 0.47), (0.5, 0.78), (0.8, 1.0))):
            wide = 1.75 - 0.42 * k
            bottom, top = -1.6 + low * (tall + 1.4), -1.6 + high * (tall + 1.4)
            sail = [(mast - wide, bottom), (mast - 0.82 * wide, top), (mast + 0.82 * wide, top)]
            sail += [(mast + 1.12 * wide, bottom + 0.1), (mast + 0.2, bottom + 0.45)]
            belly = 0.32 * _body(x, y, sail, edge=0.75)
            seams = 1 - 0.16 * (np.abs(np.mod((x - mast) / 0.55, 1) - 0.5) < 0.09)
            height = np.maximum(height, belly * seams)
    for rope in (
        [(5.6, -1.2), (7.0, 0.4)],
        [(7.0, 0.4), (3.2, 4.4)],
        [(-3.2, 4.6), (-5.4, -1.4)],
        [(3.2, 4.4), (0.2, 6.2)],
    ):
        height = np.maximum(height, 0.10 * _lines(x, y, [(np.array(rope[0]), np.array(rope[1]))], 0.13))
    for k in range(4):
        way = np.linspace(-6.6, 6.6, 27)
        wave = np.stack([way, -4.5 - 0.62 * k + 0.22 * np.sin(2.2 * way + 1.9 * k + random.uniform(0, 6))], axis=1)
        kept = wave[np.hypot(*wave.T) < FIELD_R - 0.2]
        height = np.maximum(height, 0.17 * _lines(x, y, list(pairwise(kept)), 0.34))
    return height


def _tree(x: np.ndarray, y: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """An oak: bark, roots, boughs, and a crown of lobed leaves and acorns."""
    trunk = [
        (-1.5, -5.6),
        (-0.9, -3.4),
        (-0.75, -0.8),
        (0.7, -0.8),
        (0.85, -3.4),
        (1.7, -5.6),
        (0.3, -4.9),
        (-0.4, -4.9),
    ]
    bark = 1 - 0.2 * (np.sin(x * 9 + 1.2 * np.sin(y * 2.1)) > 0.55)
    height = 0.36 * _body(x, y, trunk, edge=0.8) * bark
    for side, out, tall in ((-1, 4.6, 1.2), (1, 4.8, 0.6), (-1, 3.2, 4.2), (1, 2.6, 4.6), (-1, 0.4, 5.6)):
        bough = [(0.2 * side, -1.4), (0.45 * out * side, 0.1 + 0.5 * tall), (out * side, tall)]
        height = np.maximum(height, 0.24 * _curve(x, y, bough, 0.5))
    for k in range(95):
        turn, far = random.uniform(0, 2 * np.pi), np.sqrt(random.uniform(0, 1))
        cx, cy = 5.6 * far * np.cos(turn), 2.3 + 4.0 * far * np.sin(turn)
        if np.hypot(cx, cy) > FIELD_R - 1.0 or cy < -0.4:
            continue
        a, size = random.uniform(0, 2 * np.pi), random.uniform(0.75, 1.05)
        near = (np.abs(x - cx) < 1.1) & (np.abs(y - cy) < 1.1)
        px, py = x[near] - cx, y[near] - cy
        u, v = (px * np.cos(a) + py * np.sin(a)) / size, (py * np.cos(a) - px * np.sin(a)) / size
        lobes = 0.42 * np.sqrt(np.clip(1 - u**2, 0, 1)) * (1 + 0.28 * np.cos(9 * u))
        inside = np.clip(1 - (np.abs(v) / np.maximum(lobes, 1e-3)) ** 2, 0, 1) * (np.abs(u) < 1)
        leaf = (0.22 + 0.0018 * k) * np.sqrt(inside) - 0.05 * (np.abs(v) < 0.06) * (inside > 0)
        height[near] = np.where(inside > 0.02, np.maximum(leaf, 0.12 + 0.0008 * k), height[near])
    for side in (-1, 1):
        height = np.maximum(
            height, 0.16 * _curve(x, y, [(1.2 * side, -5.3), (3 * side, -5.9), (4.6 * side, -5.7)], 0.4)
        )
    return height


def _rose(x: np.ndarray, y: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A compass rose of sixteen ridged points over rings, a star in the middle."""
    r, turn = np.hypot(x, y), np.arctan2(x, y) + float(random.uniform(0, 0.4))
    height = 0.16 * np.sqrt(np.clip(1 - ((r - 5.0) / 0.17) ** 2, 0, None))
    height = np.maximum(height, 0.16 * np.sqrt(np.clip(1 - ((r - 5.6) / 0.12) ** 2, 0, None)))
    ticks = np.abs(np.mod(turn / (2 * np.pi) * 96, 1) - 0.5) < 0.2
    height = np.maximum(height, 0.10 * ticks * (np.abs(r - 5.3) < 0.25))
    for count, reach, tall, first in ((16, 4.6, 0.22, 0.5), (8, 5.9, 0.30, 0.5), (4, 7.3, 0.42, 0.0)):
        part = (np.mod(turn / (2 * np.pi) * count + first, 1) - 0.5) * 2 * np.pi / count
        along, off = r * np.cos(part), np.abs(r * np.sin(part))
        half = np.clip((reach - along) / reach, 0, 1) * reach * 0.20 * np.clip(along / (0.16 * reach), 0, 1)
        ridge = np.clip(1 - off / np.maximum(half, 1e-6), 0, 1)
        height = np.maximum(height, tall * ridge * (0.55 + 0.45 * np.clip(1 - along / reach, 0, 1)) * (half > 0))
    return np.maximum(height, 0.46 * np.sqrt(np.clip(1 - (r / 0.95) ** 2, 0, None)))


def _fish(x: np.ndarray, y: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A scaled fish with spread fins over weed."""
    body = [(-5.9, 0.5), (-4.6, 1.9), (-1.6, 2.7), (1.6, 2.0), (4.0, 0.9), (4.4, -0.2), (1.6, -1.5),
            (-2.0, -2.0), (-4.8, -1.1)]  # fmt: skip
    dome = _body(x, y, body, edge=1.7)
    row = np.floor(y / 0.42)
    u, v = np.mod(x / 0.6 + 0.5 * np.mod(row, 2), 1) - 0.5, np.mod(y / 0.42, 1) - 0.5
    scale = 0.05 * np.clip(1 - np.hypot(u, v) * 1.5, 0, 1) * ((x > -3.6) & (dome > 0.35))
    height = 0.42 * dome + scale
    tail = [(3.9, 0.4), (5.4, 2.5), (6.6, 3.1), (6.0, 0.5), (6.7, -2.2), (5.4, -1.7)]
    back = [(-2.8, 2.4), (-1.0, 4.6), (0.8, 4.4), (2.6, 2.9), (2.0, 1.8)]
    belly = [(-1.6, -1.8), (-0.6, -3.5), (1.0, -3.1), (0.7, -1.5)]
    for fin, (cx, cy) in ((tail, (3.6, 0.2)), (back, (-0.4, 0.8)), (belly, (-0.6, -0.6))):
        rays = 1 - 0.3 * (np.sin(34 * np.arctan2(y - cy, x - cx)) > 0.2)
        height = np.maximum(height, 0.24 * _body(x, y, fin, edge=0.5) * rays)
    gill = 0.10 * _curve(x, y, [(-3.6, 1.9), (-3.1, 0.4), (-3.7, -1.2)], 0.32)
    eye = np.hypot(x + 4.7, y - 0.75)
    height += gill + 0.12 * np.sqrt(np.clip(1 - (eye / 0.42) ** 2, 0, None)) - 0.12 * (eye < 0.16)
    for k in range(7):
        foot = -5.4 + 1.8 * k
        way = np.linspace(0, 1, 36)
        path = np.stack(
            [foot + 0.35 * np.sin(6 * way + random.uniform(0, 6)), -6.4 + (2.0 + 0.8 * (k % 3)) * way], axis=1
        )
        kept = path[np.hypot(*path.T) < FIELD_R - 0.3]
        if len(kept) > 1:
            height = np.maximum(height, 0.15 * _lines(x, y, list(pairwise(kept)), 0.32))
    return height
