"""Reflectance pictures, float32 in 0..1, row 0 on top: asphalt, paint on it, paving, walls, shop signs."""

from __future__ import annotations

import numpy as np

Shape = tuple[int, int]


def noise(shape: Shape, cells: Shape, random: np.random.Generator) -> np.ndarray:
    """Smooth value noise in -1..1 over a lattice of `cells` down and across."""
    field = random.uniform(-1, 1, (cells[0] + 2, cells[1] + 2)).astype(np.float32)
    for axis in (0, 1):
        at = np.arange(shape[axis], dtype=np.float32) * (cells[axis] / shape[axis])
        first = at.astype(np.int64)
        part = at - first
        part = part * part * (3 - 2 * part)
        part = part[:, None] if axis == 0 else part[None, :]
        low = np.take(field, first, axis=axis)
        field = low + part * (np.take(field, first + 1, axis=axis) - low)
    return field


def asphalt(shape: Shape, texel_m: Shape | tuple[float, float], random: np.random.Generator) -> np.ndarray:
    """Worn asphalt: bright and dark stones, wheel polish, patched trenches, sealed cracks, oil."""
    rows, columns = shape
    high, wide = rows * texel_m[0], columns * texel_m[1]
    stones = random.standard_normal(shape, dtype=np.float32)
    ground = 0.105 * (1 + 0.30 * stones)
    cloud = noise(shape, (max(int(high / 1.1), 2), max(int(wide / 1.1), 2)), random)
    ground *= 1 + 0.16 * cloud + 0.10 * noise(shape, (max(int(high / 4), 1), max(int(wide / 4), 1)), random)
    for _ in range(int(high * wide / 90)):  # trenches dug and filled with newer, darker asphalt
        length, width = random.uniform(1.5, 7.0), random.uniform(0.5, 1.1)
        size = (length, width) if random.random() < 0.5 else (width, length)
        r, c = random.uniform(0, rows), random.uniform(0, columns)
        part = np.s_[int(r) : int(r + size[0] / texel_m[0]), int(c) : int(c + size[1] / texel_m[1])]
        ground[part] *= random.uniform(0.55, 0.8)
    for _ in range(int(high * wide / 14)):  # cracks, some of them sealed with bitumen
        steps = int(random.uniform(1.0, 4.0) / 0.01)
        heading = random.uniform(0, 2 * np.pi) + np.cumsum(random.normal(0, 0.12, steps))
        r = random.uniform(0, rows) + np.cumsum(np.sin(heading)) * 0.01 / texel_m[0]
        c = random.uniform(0, columns) + np.cumsum(np.cos(heading)) * 0.01 / texel_m[1]
        sealed = int(random.integers(1, 5))
        for k in range(sealed):
            inside = (r >= 0) & (r < rows - 1) & (c + k >= 0) & (c + k < columns - 1)
            ground[r[inside].astype(int), (c[inside] + k).astype(int)] = 0.035
    return np.clip(ground, 0.02, 0.45)


def worn_paint(
    ground: np.ndarray, where: np.ndarray, random: np.random.Generator, *, wear: float, paint: float = 0.62
) -> None:
    """Road paint over `where` (bool) in place: thin on top of the stones, gone in spots, dark with rubber."""
    rows, columns = ground.shape
    cells = (max(rows // 14, 2), max(columns // 14, 2))
    left = noise(ground.shape, cells, random) + 0.5 * random.standard_normal(ground.shape, dtype=np.float32)
    cover = np.clip(1.7 - 2.4 * wear - 0.9 * left, 0.05, 1)
    tone = paint * (1 + 0.10 * noise(ground.shape, (max(rows // 60, 2), max(columns // 60, 2)), random))
    ground[where] += (cover * (tone - ground))[where]


def paving(shape: Shape, texel_m: tuple[float, float], random: np.random.Generator) -> np.ndarray:
    """Concrete slabs of 0.40 m in running bond, each with its own tone, dark joints, stains, chewing gum."""
    row, column = (np.arange(n, dtype=np.float32) * t for n, t in zip(shape, texel_m, strict=True))
    line = np.floor(row / 0.40)
    across = column[None, :] / 0.40 + 0.5 * (line[:, None] % 2)
    down = row / 0.40
    lattice = random.uniform(0.80, 1.15, (int(line.max()) + 1, int(across.max()) + 2)).astype(np.float32)
    ground = 0.30 * lattice[line.astype(int)[:, None], across.astype(int)]
    joint = (np.abs(across % 1 - 0.5) > 0.48) | (np.abs(down % 1 - 0.5) > 0.48)[:, None]
    ground[joint] *= 0.45
    ground *= 1 + 0.12 * noise(shape, (max(shape[0] // 50, 2), max(shape[1] // 50, 2)), random)
    ground *= 1 + 0.10 * random.standard_normal(shape, dtype=np.float32)
    gum = random.random(shape) < 0.6 * texel_m[0] * texel_m[1]
    ground[gum] = 0.08
    return np.clip(ground, 0.03, 0.6)


def plaster(random: np.random.Generator, tone: float) -> np.ndarray:
    """8 m × 8 m of rendered wall: blotches, streaks of rain under the sills, fine grain."""
    shape = (320, 320)
    streak = noise(shape, (3, 110), random) + 0.6 * noise(shape, (5, 40), random)
    wall = tone * (1 + 0.09 * streak + 0.10 * noise(shape, (6, 6), random))
    wall *= 1 + 0.06 * random.standard_normal(shape, dtype=np.float32)
    return np.clip(wall, 0.03, 0.85)


def brick(random: np.random.Generator, tone: float) -> np.ndarray:
    """6 m × 6 m of brickwork in running bond, bricks of 0.24 m × 0.075 m, every one fired differently."""
    rows, columns, courses, stretchers = 960, 600, 80, 25
    y = np.arange(rows) * (courses / rows)
    course = y.astype(int)
    x = np.arange(columns)[None, :] * (stretchers / columns) + 0.5 * (course % 2)[:, None]
    fired = random.normal(1.0, 0.20, (courses, stretchers + 1))
    wall = tone * fired[course[:, None], x.astype(int) % stretchers]
    mortar = (x % 1 < 0.05) | ((y % 1) < 0.14)[:, None]
    wall[mortar] = 0.42
    wall *= 1 + 0.10 * noise((rows, columns), (8, 8), random)
    return np.clip(wall, 0.03, 0.7)


def lettering(shape: Shape, random: np.random.Generator, *, ground: float, ink: float) -> np.ndarray:
    """A shop's sign: a row of made-up letters, each of two to four strokes in a box, between two rules."""
    high, wide = shape
    sign = np.full(shape, ground, dtype=np.float32)
    sign[int(0.06 * high) : int(0.10 * high)] = sign[int(0.90 * high) : int(0.94 * high)] = ink
    size, left = int(0.5 * high), int(random.uniform(0.4, 1.4) * high)
    top, stroke = int(0.25 * high), max(int(0.09 * high), 1)
    while left < wide - int(0.9 * high):
        width = int(size * random.uniform(0.45, 0.75))
        if random.random() > 0.14:  # else a space between words
            box = sign[top : top + size, left : left + width]
            for kind in random.choice(6, size=int(random.integers(2, 5)), replace=False):
                if kind < 2:
                    edge = 0 if kind == 0 else max(width - stroke, 0)
                    box[:, edge : edge + stroke] = ink
                elif kind < 5:
                    at = (0, (size - stroke) // 2, size - stroke)[kind - 2]
                    box[at : at + stroke] = ink
                else:
                    r = np.arange(size)
                    c = (r * (width - stroke) / size).astype(int)
                    for k in range(stroke):
                        box[r, np.minimum(c + k, width - 1)] = ink
        left += width + int(0.14 * high)
    return sign
