"""Grey reflectance patterns as float32 arrays in 0..1: row 0 is the top of the surface they cover.

Nothing here draws random numbers: lattices are hashed, so a pattern is the same wherever it is made.
"""

from __future__ import annotations

import numpy as np

Shape = tuple[int, int]


def noise(shape: Shape, cells: Shape, *, seed: int) -> np.ndarray:
    """Value noise in -1..1 over `cells` lattice cells down and across; it wraps round both ways."""
    lattice = _hashed(cells, seed)
    for axis in (0, 1):
        at = np.arange(shape[axis], dtype=np.float32) * (cells[axis] / shape[axis])
        first = at.astype(np.int64)
        part = at - first
        part = part * part * (3 - 2 * part)
        part = part[:, None] if axis == 0 else part[None, :]
        following = np.take(lattice, (first + 1) % cells[axis], axis=axis)
        lattice = np.take(lattice, first, axis=axis)
        lattice += part * (following - lattice)
    return lattice


def _hashed(cells: Shape, seed: int) -> np.ndarray:
    """Uniform -1..1 float32 from the murmur3 finaliser of (row, column, seed)."""
    row, column = np.ogrid[: cells[0], : cells[1]]
    word = (row * 0x9E3779B1 + column * 0x85EBCA77 + (seed + 1) * 0xC2B2AE3D).astype(np.uint32)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35)):
        word = (word ^ (word >> np.uint32(shift))) * np.uint32(factor)
    word ^= word >> np.uint32(16)
    return (word.astype(np.float64) * (2 / 2**32) - 1).astype(np.float32)


def wood(shape: Shape, *, rings: float, mean: float, contrast: float, seed: int) -> np.ndarray:
    """Grain along the columns' direction (across the picture): growth rings, fibres and dark pores."""
    height, width = shape
    warp = noise(shape, (3, 3), seed=seed) + 0.35 * noise(shape, (7, 5), seed=seed + 1)
    ring = np.linspace(0, rings, height, dtype=np.float32)[:, None] + 0.09 * rings * warp
    ring -= np.floor(ring)
    figure = ring**3 - 0.25  # soft early wood darkens slowly into late wood, then starts afresh
    fibre = noise(shape, (height // 5, max(width // 60, 2)), seed=seed + 2)
    pores = noise(shape, (height // 5, max(width // 24, 2)), seed=seed + 3) > 0.75
    grey = 1 - contrast * (figure + 0.45 * fibre + 0.8 * pores)
    return np.clip(mean * grey, 0.02, 0.95).astype(np.float32)


def planks(shape: Shape, *, boards: int, mean: float, seed: int) -> np.ndarray:
    """Boards of `wood` one above the other, with dark joints."""
    height = shape[0] // boards
    rows = []
    for board in range(boards):
        tone = mean * (1 + 0.12 * np.sin(2.4 * board + seed))
        size, rings = (height, shape[1]), 9 + 3 * (board % 3)
        plank = wood(size, rings=rings, mean=tone, contrast=0.45, seed=seed + 10 * board)
        plank[:4] *= 0.25
        rows.append(plank)
    return np.concatenate(rows)


def kilim(shape: Shape, *, motifs: int, seed: int) -> np.ndarray:
    """A woven runner: stepped diamonds between zigzag borders, over the yarn's own texture."""
    row, column = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    y = row / shape[0] * 2 - 1
    x = column / shape[1] * motifs
    steps = np.floor(np.abs(x - np.floor(x) - 0.5) * 12) / 6
    diamond = np.floor((np.abs(y) / 0.62 + steps) * 3) % 2
    zigzag = np.abs((np.abs(y) - 0.8) / 0.2 - 0.6 * np.abs(2 * (4 * x - np.floor(4 * x)) - 1)) < 0.3
    grey = np.where(np.abs(y) < 0.62, 0.16 + 0.42 * diamond, np.where(zigzag, 0.62, 0.22))
    grey[(np.abs(y) > 0.62) & (np.abs(y) < 0.66)] = 0.08
    yarn = 1 + 0.22 * noise(shape, (shape[0] // 5, shape[1] // 9), seed=seed)
    return np.clip(grey * yarn, 0.02, 0.9).astype(np.float32)


def wallpaper(shape: Shape, *, stripes: int, seed: int) -> np.ndarray:
    """Broad stripes with a sprig in every other one, on slightly uneven paper."""
    row, column = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    x = column / shape[1] * stripes
    y = row / shape[0] * stripes * shape[0] / shape[1]
    u, v = x - np.floor(x) - 0.5, y - np.floor(y) - 0.5
    angle, radius = np.arctan2(v, u), np.hypot(u, v)
    sprig = radius < 0.24 * (1 + 0.55 * np.cos(5 * angle))
    grey = 0.38 + 0.06 * (np.floor(x) % 2) - 0.20 * sprig
    grey[np.abs(u) > 0.46] = 0.20
    return (grey * (1 + 0.05 * noise(shape, (shape[0] // 6, shape[1] // 6), seed=seed))).astype(np.float32)


def spine(shape: Shape, *, ground: float, ink: float, seed: int) -> np.ndarray:
    """Book cloth with double rules at head and foot and a title set in blocks down the middle."""
    grey = np.full(shape, ground, dtype=np.float32)
    height, width = shape
    for at in (0.06, 0.10, 0.86, 0.90):
        grey[int(at * height) : int((at + 0.015) * height)] = ink
    letter = height // 40
    marks = _hashed((16, 3), seed)
    for number, (long, wide, _) in enumerate(marks):
        top = int(0.42 * height) + number * letter
        inset = int(width * (0.3 + 0.06 * wide))
        if long > -0.6:
            grey[top : top + int(0.6 * letter), inset : width - inset] = ink
    return np.clip(grey * (1 + 0.15 * noise(shape, (height // 3, width // 3), seed=seed)), 0.02, 0.9)


def glaze(shape: Shape, *, ground: float, ink: float, waves: int, seed: int) -> np.ndarray:
    """Ceramic glaze with painted lines and a wavy band; rows run from the rim to the foot."""
    row, column = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    y, turn = row / shape[0], column / shape[1]
    band = np.abs(y - 0.42 - 0.06 * np.sin(2 * np.pi * waves * turn)) < 0.025
    lines = (np.abs(y - 0.28) < 0.008) | (np.abs(y - 0.56) < 0.008) | (np.abs(y - 0.60) < 0.02)
    grey = np.where(band | lines, ink, ground)
    return (grey * (1 + 0.04 * noise(shape, (40, 40), seed=seed))).astype(np.float32)


def peel(shape: Shape, *, seed: int) -> np.ndarray:
    """Orange peel: fine dark pits on a mottled skin."""
    pits = np.clip(noise(shape, (shape[0] // 6, shape[1] // 6), seed=seed), 0, 1) ** 2
    mottle = noise(shape, (9, 18), seed=seed + 1)
    return (0.30 * (1 + 0.1 * mottle) * (1 - 0.5 * pits)).astype(np.float32)
