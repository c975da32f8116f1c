"""Grey reflectances of wall, table and pencil, 0..1, and the noise of all prints; row 0 is the top."""

from __future__ import annotations

import numpy as np

Shape = tuple[int, int]


def noise(shape: Shape, cells: tuple[float, float], random: np.random.Generator) -> np.ndarray:
    """Value noise in -1..1 with so many lattice cells down and across."""
    lattice = random.uniform(-1, 1, [int(n) + 2 for n in cells]).astype(np.float32)
    for axis in (0, 1):
        at = np.arange(shape[axis], dtype=np.float32) * np.float32(cells[axis] / shape[axis])
        first = at.astype(np.int64)
        part = at - first
        part *= part * (3 - 2 * part)
        part = part[:, None] if axis == 0 else part
        here = np.take(lattice, first, axis=axis)
        lattice = here + part * (np.take(lattice, first + 1, axis=axis) - here)
    return lattice


def cloudy(shape: Shape, cells: float, octaves: int, random: np.random.Generator) -> np.ndarray:
    """Octaves of noise, each twice as fine and half as strong, about -1..1; cells across the first one."""
    high = cells * shape[0] / shape[1]
    layers = (noise(shape, (high * 2**k, cells * 2**k), random) * 0.5**k for k in range(octaves))
    return sum(layers, np.zeros(shape, np.float32))


def bricks(width_m: float, height_m: float, texel_m: float, random: np.random.Generator) -> np.ndarray:
    """Stretcher bond of 215 mm x 65 mm bricks in 10 mm of mortar: tone, pits and chipped rims differ."""
    shape = round(height_m / texel_m), round(width_m / texel_m)
    wander = 0.0022 * cloudy(shape, 40, 3, random)
    y = np.arange(shape[0], dtype=np.float32)[:, None] * texel_m + wander
    course = np.floor(y / 0.075).astype(np.int64)
    x = np.arange(shape[1], dtype=np.float32) * texel_m + 0.1125 * (course % 2) + wander[::-1]
    brick = np.floor(x / 0.225).astype(np.int64)
    u, v = x - 0.225 * brick, y - 0.075 * course
    depth = np.minimum(np.minimum(u - 0.005, 0.220 - u), np.minimum(v - 0.005, 0.070 - v))
    tone = random.uniform(0.16, 0.34, (course.max() + 1, brick.max() + 1)).astype(np.float32)[course, brick]
    grain = cloudy(shape, width_m / 0.012, 4, random)
    pits = noise(shape, (height_m / 0.003, width_m / 0.003), random) > 0.7
    face = tone * (1 + 0.28 * grain - 0.35 * pits)
    mortar = 0.46 * (1 + 0.22 * grain[::-1, ::-1])
    return np.clip(np.where(depth > 0, face, mortar), 0.03, 0.9).astype(np.float32)


def planks(shape: Shape, boards: int, random: np.random.Generator) -> np.ndarray:
    """Oiled boards side by side, their grain running across the picture, with dark joints and scratches."""
    rows = []
    for edge in np.array_split(np.arange(shape[0]), boards):
        size = (len(edge), shape[1])
        bent = noise(size, (1.5, 3), random) + 0.3 * noise(size, (3, 7), random)
        rings = np.arange(size[0], dtype=np.float32)[:, None] * random.uniform(6, 10) / size[0] + 1.6 * bent
        late = (rings - np.floor(rings)) ** 3
        fibre = noise(size, (size[0] / 3, size[1] / 60), random)
        board = random.uniform(0.17, 0.25) * (1.1 - 0.45 * late + 0.16 * fibre)
        board[:3] *= 0.3
        rows.append(board)
    worn = 1 + 0.10 * cloudy(shape, 6, 3, random)
    return np.clip(np.concatenate(rows) * worn, 0.02, 0.9).astype(np.float32)


def pencil(random: np.random.Generator) -> np.ndarray:
    """Painted stripes round a pencil, a metal ferrule at its blunt end, bare wood and lead at the other."""
    up, round_ = np.linspace(1, 0, 480, dtype=np.float32)[:, None], np.linspace(0, 1, 96, dtype=np.float32)
    grey = np.where(np.floor(round_ * 6) % 2 == 0, 0.10, 0.42) * np.ones_like(up)
    grey[(np.abs(up - 0.07) < 0.05)[:, 0]] = 0.6
    grey[(np.abs(up - 0.07) < 0.05)[:, 0] & (np.sin(up[:, 0] * 500) > 0.3)] = 0.35
    bare = up > 0.82 + 0.012 * np.cos(12 * np.pi * round_)
    grey = np.where(bare, 0.55 * (1 + 0.2 * noise(grey.shape, (20, 60), random)), grey)
    return np.where(up > 0.965, 0.06, grey).astype(np.float32)
