"""A wedge of blue cheese: a cut face with veins and holes, a crumbled top, a rind at its end; millimetres."""

from __future__ import annotations

import numpy as np
from clay import Clay
from solid_noise import cells, solid_noise
from solids import Body

LONG_MM, HIGH_MM, ANGLE_DEG = 56.0, 25.0, 36.0
PASTE, BLUE, RIND = 0.62, 0.11, 0.20
SKIN_MM = 2.0  # how far from the edge fields are carved
TIP = np.array([-27.0, 0.0, 9.0])


def wedge(cell: float, random: np.random.Generator) -> Body:
    """The tip lies to the left, the cut face looks to +z, the rind ends it on the right."""
    clay = Clay((-30, -1, -31), (33, HIGH_MM + 4, 13), cell=cell)
    x, y, z = np.meshgrid(*clay.axes, indexing="ij", sparse=True)
    clay.field = np.maximum.reduce(np.broadcast_arrays(*_sides(x, y, z))).astype(np.float32)
    shown = (z - TIP[2] > -SKIN_MM) | (y - HIGH_MM > -SKIN_MM)  # the face and the top, where it is carved
    near = np.nonzero((np.abs(clay.field) < SKIN_MM) & shown)
    points = np.stack([axis[k] for axis, k in zip(clay.axes, near, strict=True)], axis=1)
    mould = random.integers(1 << 30)
    vein, room = _veins(points, np.random.default_rng(mould))
    break_ = _broken(points, random)
    lumps = cells(points + 0.5 * solid_noise(points, 2.0, random)[:, None], 2.6, random)
    lean = random.normal(0, 0.16, (lumps.number.max() + 1, 3))[lumps.number]
    facets = 0.5 * random.standard_normal(lumps.number.max() + 1)[lumps.number] + (lean * lumps.away).sum(axis=1)
    fine = solid_noise(points, 1.1, random, octaves=2)
    hole = 2.4 * np.clip(1.25 * vein - 0.35, 0, 1) * room
    clay.field[near] += (hole + break_ * (0.75 * facets + 0.45) + (0.10 + 0.22 * break_) * fine).astype(np.float32)
    points, triangles = clay.mesh()
    vein, room = _veins(points, np.random.default_rng(mould))
    rind = np.clip(1 + np.hypot(*(points - TIP).T[[0, 2]]) / 1.1 - (LONG_MM - 1.6) / 1.1, 0, 1)
    broad, fine = solid_noise(points, 8.0, random, octaves=3), solid_noise(points, 0.9, random, octaves=3)
    blue = np.clip(vein * (0.75 + 0.5 * fine) + 0.30 * np.clip(room - 0.5, 0, 1), 0, 1)
    tone = PASTE * (1 + 0.05 * broad + 0.07 * fine)
    tone = tone + blue * (BLUE * (1 + 0.5 * fine) - tone)
    tone = tone + rind * (RIND * (1 + 0.45 * broad + 0.55 * fine) - tone)
    tone = tone * (1 + 0.04 * random.standard_normal(len(points)))
    uv = np.stack([points[:, 0] + 0.55 * points[:, 2], points[:, 1] - 0.45 * points[:, 2]], axis=1) / 20.0
    return Body(points, triangles, uv, np.clip(tone, 0.03, 0.8))


def _sides(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
    """Distances to the cut face, the other cut, the rind, the top and the foot; negative inside."""
    a = np.radians(ANGLE_DEG)
    dx, dz = x - TIP[0], z - TIP[2]
    return [dz, -(dz * np.cos(a) + dx * np.sin(a)), np.hypot(dx, dz) - LONG_MM, y - HIGH_MM, -y]


def _broken(points: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """1 where the cheese was broken, on its top and at its edges; 0 where a wire has cut it."""
    cut, other, _, top, _ = _sides(*points.T)
    edge = np.maximum(cut, other) + 0.5 * solid_noise(points, 6.0, random, octaves=2)
    return np.clip(1.3 + (top + 0.4) / 2.2, 0, 1) * np.clip(0.45 - 0.4 * edge, 0.25, 1)


def _veins(points: np.ndarray, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """How blue the paste is, and how open: moulds grow along seams between curds."""
    bent = points + 1.6 * np.stack([solid_noise(points, 5.0, random) for _ in range(3)], axis=1)
    seam = cells(bent, 8.0, random).wall
    grown = np.clip(0.75 + 1.2 * solid_noise(points, 11.0, random, octaves=2), 0, 1)
    wide = 0.30 + 1.5 * np.clip(solid_noise(points, 4.5, random) + 0.2, 0, 1)
    vein = np.exp(-((seam / wide) ** 2)) * grown
    spot = np.clip(3.2 * solid_noise(points, 4.2, random, octaves=3) - 1.35, 0, 1)
    room = np.clip(2.4 * solid_noise(points, 5.0, random) - 0.1, 0, 1)
    return np.maximum(vein, spot), room
