"""Apple blossom: five cupped petals, sepals between them, a crown of stamens."""

from __future__ import annotations

import numpy as np
from meshes import Body, copies, joined, quads, tube

PETAL_M = 0.021
WIDE, HIGH = 64, 64


def petal() -> Body:
    """One petal along +y, 1 long, hollow towards +z, its edge a little wavy."""
    t, s = np.linspace(0, 1, 13), np.linspace(-1, 1, 11)
    half = 0.46 * np.sin(np.pi * np.clip(t, 0.03, 0.985) ** 1.35 / 1.02) ** 0.55
    x = half[:, None] * s
    z = 0.30 * t[:, None] ** 1.6 + 0.55 * x**2 + 0.03 * np.sin(8 * s + 3 * t[:, None]) * t[:, None]
    y = 0.10 + 0.95 * np.broadcast_to(t[:, None], x.shape) - 0.1 * s**2 * (t[:, None] > 0.8)
    uv = np.stack([0.5 + 0.5 * x / 0.5, np.broadcast_to(t[:, None], x.shape)], axis=2)
    return Body(np.stack([x, y, z], axis=2).reshape(-1, 3), quads(13, 11), uv.reshape(-1, 2))


def blossoms(flowers: list[tuple[np.ndarray, np.ndarray]], random: np.random.Generator) -> tuple[Body, Body]:
    """Petals of all flowers, each a place and the way that it looks; and their stamens with sepals."""
    one = petal()
    places, frames, sizes, threads = [], [], [], []
    for place, face in flowers:
        side = np.cross(face, [0.0, 1.0, 0.0])
        side /= np.linalg.norm(side)
        up = np.cross(side, face)
        turn = random.uniform(0, 2 * np.pi)
        size = PETAL_M * random.uniform(0.85, 1.15)
        for k in range(5):
            a = turn + 2 * np.pi * k / 5 + random.normal(0, 0.07)
            along = np.cos(a) * side + np.sin(a) * up
            places.append(place)
            frames.append([np.cross(along, face), along, face])
            sizes.append(size * random.uniform(0.93, 1.07))
        for _ in range(16):
            a, lean = random.uniform(0, 2 * np.pi), random.uniform(0.1, 0.55)
            way = face + lean * (np.cos(a) * side + np.sin(a) * up)
            tip = place + 0.42 * size * way
            threads.append(tube(np.linspace(place, tip, 3), np.full(3, 0.00030), around=4, tone=0.6))
            knob = np.linspace(tip, tip + 0.0016 * face, 3)
            threads.append(tube(knob, np.array([0.0004, 0.0008, 0.0004]), around=5, tone=0.42))
        threads.append(
            tube(
                np.linspace(place - 0.006 * face, place + 0.001 * face, 3),
                np.array([0.0012, 0.0028, 0.0022]),
                tone=0.18,
            )
        )
    uv = np.tile(one.uv, (len(places), 1, 1))
    return copies(one, np.array(places), np.array(frames), np.array(sizes), uv), joined(threads)


def skin(random: np.random.Generator, contrast: float) -> np.ndarray:
    """White, flushed with red towards the edge, fine veins; row 0 at the claw."""
    v, u = np.meshgrid(np.linspace(0, 1, HIGH), np.linspace(-1, 1, WIDE), indexing="ij")
    fan = u / (0.25 + v)
    veins = 1 - 0.14 * contrast * (np.sin(17 * fan + 0.5 * np.sin(9 * v)) > 0.75)
    flush = 1 - 0.38 * contrast * np.clip(v - 0.45 + 0.25 * u**2 + 0.1 * random.standard_normal(), 0, 1)
    return (0.86 * veins * flush).astype(np.float32)
