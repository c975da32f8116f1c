"""The far end of a living room, to stand out of focus: painted wall, bookcase, curtain, framed print."""

from __future__ import annotations

from typing import Any

import numpy as np
from solids import Body, box, grid, joined, placed
from surfaces import cloudy, glossy, matte, mesh, noise, texture

SPINES = 48


def room(random: np.random.Generator, *, wall_z: float, low: float = -0.62) -> dict[str, Any]:
    """Entries of a scene (metres): a wall at ``wall_z``, which faces +z, and what stands before it.

    low : height at which the bookcase stands.
    """
    side = float(random.choice([-1, 1]))
    paint = 0.42 * (1 + 0.03 * cloudy((600, 900), 16, 4, random) + 0.03 * noise((600, 900), (250, 370), random))
    wall = _upright((-1.5, 1.5), (-1.0, 1.0), wall_z)
    picture = _upright((-0.19 * side - 0.11, -0.19 * side + 0.11), (-0.05, 0.25), wall_z + 0.012)
    scene: dict[str, Any] = {
        "wall": mesh("wall", wall, matte(texture(paint))),
        "print": mesh("print", picture, glossy(texture(_print(random)), 0.05)),
    }
    books, shelves = _bookcase(random)
    stand = ((0.30 * side + (0 if side > 0 else -0.9)), low, wall_z)
    scene["books"] = mesh("books", placed(books, stand), glossy(texture(_spines(random)), 0.25), smooth=False)
    scene["bookcase"] = mesh("bookcase", placed(shelves, stand), glossy(texture(_wood(random)), 0.3), smooth=False)
    folds = np.linspace(0, 1, 260)
    x = -side * (0.36 + 0.75 * folds)
    z = wall_z + 0.13 + 0.035 * np.sin(40 * folds + 2 * np.sin(9 * folds)) + 0.012 * np.sin(97 * folds)
    curtain = np.stack([[[a, y, b] for a, b in zip(x, z, strict=True)] for y in (-0.9, 0.9)])
    weave = 0.30 * (1 + 0.2 * noise((500, 700), (240, 340), random) + 0.1 * noise((500, 700), (10, 300), random))
    scene["curtain"] = mesh("curtain", grid(curtain), matte(texture(np.clip(weave, 0.05, 0.6))))
    return scene


def _upright(x: tuple[float, float], y: tuple[float, float], z: float) -> Body:
    return grid([[(a, b, z) for a in x] for b in y])


def _bookcase(random: np.random.Generator) -> tuple[Body, Body]:
    """Four shelves, 0.9 m wide, its lower left corner at the origin."""
    books, boards = [], [box((x, 0, 0), (x + 0.02, 1.5, 0.27)) for x in (-0.02, 0.9)]
    for row in range(5):
        low = 0.32 * row
        boards.append(box((0, low - 0.02, 0), (0.9, low, 0.27)))
        at, kind = 0.004, int(random.integers(0, SPINES))
        high = random.uniform(0.19, 0.26)
        while at < 0.85:
            if random.uniform() < 0.12:
                kind, high = int(random.integers(0, SPINES)), random.uniform(0.17, 0.27)
            wide = random.uniform(0.014, 0.045)
            kind = int(random.integers(0, SPINES))
            top, out = high * random.uniform(0.82, 1.08), random.uniform(0.19, 0.25)
            book = box((at, low, 0.02), (at + wide, low + min(top, 0.285), out))
            books.append(book._replace(uv=(book.uv * [0.96 / SPINES, 1]) + [(kind + 0.02) / SPINES, 0]))
            at += wide + random.uniform(0.0005, 0.003) + (0.12 * random.uniform() if random.uniform() < 0.05 else 0)
    return joined(books), joined(boards)


def _spines(random: np.random.Generator) -> np.ndarray:
    """An atlas of spines: a ground, bands, and a title in lines as of letters."""
    rows, columns = 512, 24 * SPINES
    grey = np.empty((rows, columns), dtype=np.float32)
    for k in range(SPINES):
        ground = float(np.exp(random.uniform(np.log(0.04), np.log(0.7))))
        ink = 0.7 if ground < 0.25 else 0.05
        one = np.full((rows, 24), ground, dtype=np.float32)
        for _ in range(int(random.integers(0, 4))):
            r = int(random.integers(10, rows - 30))
            one[r : r + int(random.integers(3, 22))] = float(random.uniform(0.05, 0.7))
        r0, r1 = np.sort(random.integers(60, rows - 60, 2))
        for line in ((9, 13),) if random.uniform() < 0.6 else ((6, 10), (14, 17)):
            letters = random.uniform(0, 1, (max(int(r1 - r0) // 5, 1), 1)) < 0.72
            strokes = np.repeat(letters, 5, axis=0) & (np.arange(letters.size * 5)[:, None] % 5 < 4)
            one[r0 : r0 + len(strokes), line[0] : line[1]] = np.where(strokes, ink, ground)
        grey[:, 24 * k : 24 * k + 24] = one
    return np.clip(grey * (1 + 0.06 * cloudy((rows, columns), 60, 3, random)), 0.02, 0.8)


def _wood(random: np.random.Generator) -> np.ndarray:
    grain = noise((400, 600), (110, 4), random) + 0.5 * noise((400, 600), (190, 12), random)
    return np.clip(0.20 * (1 + 0.25 * grain), 0.03, 0.6)


def _print(random: np.random.Generator) -> np.ndarray:
    """Hills under a low sun, in a mount and a dark frame."""
    rows, columns = 420, 320
    y, x = np.mgrid[0:rows, 0:columns].astype(np.float32)
    grey = np.full((rows, columns), 0.04, dtype=np.float32)
    grey[(np.abs(x - 160) < 146) & (np.abs(y - 210) < 196)] = 0.72
    view = (np.abs(x - 160) < 104) & (np.abs(y - 210) < 146)
    sky = 0.35 + 0.3 * y / rows + 0.05 * cloudy((rows, columns), 6, 4, random)
    grey[view] = sky[view]
    grey[view & (np.hypot(x - 205, y - 165) < 15)] = 0.8
    for k in range(5):
        top = (
            190
            + 34 * k
            + 20 * noise((1, columns), (1, 5 + 2 * k), random)[0]
            + 6 * noise((1, columns), (1, 40), random)[0]
        )
        grey[view & (y > top)] = 0.36 - 0.07 * k
    return np.clip(grey * (1 + 0.05 * noise((rows, columns), (200, 150), random)), 0.02, 0.85)
