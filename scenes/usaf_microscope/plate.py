"""What the plate looks like close by: glass with scratches, holes in the chromium, dust and lint on top."""

from __future__ import annotations

import numpy as np

TEXEL_UM = 0.6  # a pixel sees 2 µm


def holes(size_um: tuple[float, float], wear: float, random: np.random.Generator) -> np.ndarray:
    """Opacity of the chromium, float32 (row, col), row 0 at the bottom: pinholes, scratches."""
    opacity = _blank(size_um)
    area_mm2 = size_um[0] * size_um[1] * 1e-6
    for _ in range(round(350 * wear * area_mm2)):
        at, radius = random.uniform(0, 1, 2) * size_um, 0.5 + random.exponential(0.6)
        window, x, y = _window(opacity, at, 3 * radius + 2)
        ragged = radius * (1 + 0.3 * np.sin(3 * np.arctan2(y, x) + random.uniform(0, 6.3)))
        opacity[window] = np.minimum(opacity[window], _step(np.hypot(x, y) - ragged))
    for _ in range(round(7 * wear)):
        _scratch(opacity, size_um, random.uniform(0.4, 0.9), random.uniform(0.6, 1.0), random)
    return opacity


def glass(size_um: tuple[float, float], wear: float, random: np.random.Generator) -> np.ndarray:
    """Share of the light that the plate lets through, relative to clean glass, float32 (row, col)."""
    clear = _blank(size_um)
    for _ in range(round(24 * wear)):  # sleeks of the polish: fine, straight, faint
        _scratch(clear, size_um, random.uniform(0.4, 1.4), random.uniform(0.05, 0.35), random)
    for _ in range(round(26 * wear)):  # residue of dried drops: rings
        at, radius = random.uniform(0, 1, 2) * size_um, random.uniform(4, 45)
        window, x, y = _window(clear, at, radius + 8)
        angle = np.arctan2(y, x)
        rim = radius * (1 + 0.06 * np.sin(2 * angle + random.uniform(0, 6.3)) + 0.03 * np.sin(5 * angle))
        r = np.hypot(x, y)
        ring = np.exp(-(((r - rim) / 1.6) ** 2)) + 0.25 * (r < rim)
        clear[window] *= 1 - random.uniform(0.03, 0.2) * ring.astype(np.float32)
    return clear


def _blank(size_um: tuple[float, float]) -> np.ndarray:
    return np.ones((round(size_um[1] / TEXEL_UM), round(size_um[0] / TEXEL_UM)), np.float32)


def _window(image: np.ndarray, at: np.ndarray, reach: float) -> tuple[tuple[slice, slice], np.ndarray, np.ndarray]:
    """The part of an image round a point (µm), and the coordinates there, counted from the point."""
    spans = []
    for place, n in ((at[1], image.shape[0]), (at[0], image.shape[1])):
        first = min(max(int((place - reach) / TEXEL_UM), 0), n - 1)
        spans.append(slice(first, min(max(int((place + reach) / TEXEL_UM) + 1, first + 1), n)))
    y, x = (
        (np.arange(s.start, s.stop, dtype=np.float32) + 0.5) * TEXEL_UM - place
        for s, place in zip(spans, (at[1], at[0]), strict=True)
    )
    return (spans[0], spans[1]), x[None, :], y[:, None]


def _step(distance: np.ndarray) -> np.ndarray:
    """0 inside, 1 outside, over one texel."""
    return np.clip(distance / TEXEL_UM + 0.5, 0, 1).astype(np.float32)


def _scratch(
    image: np.ndarray, size_um: tuple[float, float], width: float, depth: float, random: np.random.Generator
) -> None:
    """Multiplies a slightly bent line into an image; it fades out at both ends and skips."""
    length = random.uniform(60, 500)
    count = int(2 * length / TEXEL_UM)
    s = np.linspace(-0.5, 0.5, count)
    turn = random.uniform(0, 2 * np.pi) + random.normal(0, 0.25) * s
    step = length / count
    path = random.uniform(0, 1, 2) * size_um + np.cumsum(np.stack([np.cos(turn), np.sin(turn)], 1), 0) * step
    strength = depth * (1 - (2 * np.abs(s)) ** 4) * (0.6 + 0.4 * np.sin(s * random.uniform(8, 40)) > 0.35)
    loss = np.zeros_like(image)
    reach = int(np.ceil((width / 2) / TEXEL_UM + 0.5))
    column, row = path[:, 0] / TEXEL_UM - 0.5, path[:, 1] / TEXEL_UM - 0.5
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            i, j = np.rint(row).astype(int) + dy, np.rint(column).astype(int) + dx
            inside = (i >= 0) & (i < image.shape[0]) & (j >= 0) & (j < image.shape[1])
            away = np.hypot(i - row, j - column) * TEXEL_UM - width / 2
            value = strength * (1 - _step(away))
            np.maximum.at(loss, (i[inside], j[inside]), value[inside].astype(np.float32))
    image *= 1 - loss


def grains(count: int, half: tuple[float, float], random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Dust on the plane z = 0: vertices (µm) and faces; flat lumps of 3 to 22 µm with uneven outlines."""
    ball, faces = _ball()
    vertices = []
    for size in 3.0 + random.exponential(3.0, count).clip(max=19.0):
        lump = ball * (1 + 0.45 * _ripple(ball, random))[:, None] * random.uniform([0.6, 0.35, 0.25], [1, 0.8, 0.5])
        angle = random.uniform(0, 2 * np.pi)
        c, s = np.cos(angle), np.sin(angle)
        lump = lump @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) * size / 2
        lump[:, 2] -= lump[:, 2].min() - 0.3
        lump[:, :2] += random.uniform(-1, 1, 2) * half
        vertices.append(lump)
    every = np.concatenate([faces + k * len(ball) for k in range(count)])
    return np.concatenate(vertices), every


def _ripple(points: np.ndarray, random: np.random.Generator) -> np.ndarray:
    waves = random.normal(0, 2.2, (5, 3))
    return np.sin(points @ waves.T + random.uniform(0, 6.3, 5)).mean(axis=1)


def _ball(rings: int = 9, around: int = 14) -> tuple[np.ndarray, np.ndarray]:
    """A unit sphere of latitudes and longitudes."""
    up = np.linspace(0, np.pi, rings)
    on = np.arange(around) * 2 * np.pi / around
    points = np.stack(
        [np.outer(np.sin(up), np.cos(on)), np.outer(np.sin(up), np.sin(on)), np.outer(np.cos(up), np.ones(around))],
        axis=-1,
    ).reshape(-1, 3)
    return points, _skin(rings, around)


def _skin(rings: int, around: int) -> np.ndarray:
    """Faces of a tube of so many rings."""
    ring, k = np.meshgrid(np.arange(rings - 1), np.arange(around), indexing="ij")
    a, b = ring * around + k, ring * around + (k + 1) % around
    return np.concatenate(
        [np.stack([a, a + around, b], -1).reshape(-1, 3), np.stack([b, a + around, b + around], -1).reshape(-1, 3)]
    )


def lint(start: np.ndarray, heading: float, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A textile fibre over the plane z = 0: lies on it at one end and rises to some 50 µm, curled."""
    count, around, length = 150, 10, random.uniform(350, 520)
    s = np.linspace(0, 1, count)
    bend = random.normal(0, 1, 4)
    turn = heading + sum(b * np.sin((k + 1) * np.pi * s + k) / (k + 1) for k, b in enumerate(bend))
    flat = np.cumsum(np.stack([np.cos(turn), np.sin(turn)], 1), 0) * length / count
    radius = random.uniform(4.0, 6.5)
    height = radius + 0.5 + 48 * s**1.6 * (1 + 0.25 * np.sin(7 * s + bend[0]))
    middle = np.column_stack([start + flat, height])
    along = np.gradient(middle, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along, [0, 0, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, along)
    angle = np.arange(around) * 2 * np.pi / around + 5 * s[:, None]  # twisted
    flattened = 0.55
    points = middle[:, None] + radius * (
        np.cos(angle)[..., None] * side[:, None] + flattened * np.sin(angle)[..., None] * up[:, None]
    )
    return points.reshape(-1, 3), _skin(count, around)
