"""What is eaten, as bodies that stand on y = 0 round the origin; millimetres."""

from __future__ import annotations

import numpy as np
import pictures
from solids import Body, ball, box, grid, joined, placed, rounded, tube, turning
from surfaces import cloudy, noise

ROLL_MM = (28.0, 17.0, 21.0)
CHEESE_MM = (40.0, 19.0, 25.0)
CELL_MM = 0.16  # of the cheese's faces; a pixel sees 0.21 mm
CREAM, BLUE, RIND = 0.66, 0.17, 0.34


def roll(flour: float, random: np.random.Generator) -> Body:
    """A crusty roll: its poles lie left and right, the scored cut runs along its top."""
    rings, around = 150, 240
    made = ball((0, 0, 0), ROLL_MM[::-1], rings=rings, around=around)
    bulge = 0.9 * cloudy((rings + 1, around + 1), 4, 2, random) + 0.22 * cloudy(
        (rings + 1, around + 1), 30, 2, random
    )
    across = (np.linspace(0, 1, around + 1)[None, :] - pictures.CUT_U) / 0.045
    along = np.abs(np.linspace(-1, 1, rings + 1))[:, None]
    lips = 2.0 * np.exp(-((np.abs(across) - 1) ** 2) * 8) - 2.4 * np.exp(-(across**2) * 2.5)
    out = bulge + lips * np.clip((0.72 - along) / 0.2, 0, 1)
    out *= np.sin(np.linspace(0, np.pi, rings + 1))[:, None] ** 0.5
    out[:, -1] = out[:, 0]
    points = made.vertices * [ROLL_MM[1] / ROLL_MM[2], ROLL_MM[0] / ROLL_MM[1], ROLL_MM[2] / ROLL_MM[0]]
    normal = points / np.linalg.norm(points, axis=1, keepdims=True)
    points = points + normal * out.reshape(-1, 1)
    points[:, 0] = np.maximum(points[:, 0], -0.8 * ROLL_MM[1])  # it was baked on a sheet
    return placed(made._replace(vertices=points), (0, 0.8 * ROLL_MM[1], 0), turn=turning([0, 0, 1], 90))


def cheese(random: np.random.Generator) -> Body:
    """A block of blue cheese: veins and holes in two cut faces, a natural rind behind and at the sides."""
    wide, high, deep = CHEESE_MM
    x, y, z = wide / 2, high, deep / 2
    front = _cut_face((-x, 0, z), (wide, 0, 0), (0, high, 0), random)
    top = _cut_face((-x, y, z), (wide, 0, 0), (0, 0, -deep), random)
    inner = box((-x + 0.4, 0.1, -z), (x - 0.4, y - 1.8, z - 1.8), tone=0.5)
    sides = []
    for sign in (-1, 1):
        body = _cut_face((sign * x, 0, sign * z), (0, 0, -sign * deep), (0, high, 0), random)
        sides.append(body)
    back = _cut_face((x, 0, -z), (-wide, 0, 0), (0, high, 0), random)
    back = back._replace(tone=np.full(len(back.tone), RIND))
    return joined([front, top, *sides, back, inner])


def _cut_face(
    corner: tuple[float, ...], across: tuple[float, ...], up: tuple[float, ...], random: np.random.Generator
) -> Body:
    """A crumbly face: marbled veins lie a little deeper, holes deeper; it meets its neighbours at its rim."""
    a, b, normal = np.asarray(across), np.asarray(up), np.cross(across, up)
    wide, high = np.linalg.norm(a), np.linalg.norm(b)
    shape = round(high / CELL_MM), round(wide / CELL_MM)
    cells = wide / 11
    bent = cloudy(shape, cells, 3, random)
    vein = np.clip(1.2 - np.abs(bent) * 9, 0, 1) * np.clip(
        0.55 + 1.4 * noise(shape, (high / 12, wide / 12), random), 0, 1
    )
    spots = np.clip((cloudy(shape, wide / 4, 2, random) - 0.72) * 6, 0, 1)
    holes = np.clip((cloudy(shape, wide / 6, 2, random) - 0.86) * 8, 0, 1)
    blue = np.clip(np.maximum(vein, spots), 0, 1)
    grain = 0.10 * cloudy(shape, wide / 1.2, 2, random)
    tone = CREAM * (1 + 0.05 * cloudy(shape, cells, 3, random) + 0.25 * grain) * (1 - blue) + BLUE * blue
    u, v = (
        np.linspace(0, 1, n)[None, :] if k else np.linspace(0, 1, n)[:, None]
        for k, n in ((1, shape[1]), (0, shape[0]))
    )
    rim = np.clip(np.minimum(np.minimum(u, 1 - u) * wide, np.minimum(v, 1 - v) * high) / 0.8, 0, 1)
    depth = rim * (0.15 * grain - 0.30 * blue - 1.1 * holes + 0.2 * cloudy(shape, cells * 2, 2, random))
    points = np.asarray(corner) + u[..., None] * a + v[..., None] * b
    points = points + depth[..., None] * normal / np.linalg.norm(normal)
    return grid(points, tone=np.clip(tone * (1 - 0.5 * holes), 0.05, 0.8))


def berries(random: np.random.Generator) -> Body:
    """Raspberries and blueberries in a heap."""
    places = [
        (-15, 0, 9),
        (3, 0, 12),
        (18, 0, 6),
        (-8, 0, -6),
        (9, 0, -7),
        (-1, 11, 1),
        (-22, 0, -5),
        (22, 0, -9),
    ]
    made = []
    for k, place in enumerate(places):
        turn = turning(random.normal(0, 1, 3), float(random.uniform(0, 180)))
        if k % 2:
            body, lift = _blueberry(float(random.uniform(6.2, 7.6)), random), 6.8
            look = turning([1, 0, 0], float(random.uniform(-10, 80))) @ turning(
                [0, 1, 0], float(random.uniform(0, 360))
            )
            turn = turning([0, 0, 1], float(random.uniform(-35, 35))) @ look
        else:
            body, lift = _raspberry(random), 8.2
            turn = turning([0, 1, 0], float(random.uniform(0, 360))) @ turning(
                [0, 0, 1], float(random.uniform(-60, 60))
            )
        shift = np.array(place) + random.uniform(-1, 1, 3) * [1, 0, 1] + np.array([0, lift, 0])
        made.append(placed(body, shift, turn=turn))
    return joined(made)


def _raspberry(random: np.random.Generator) -> Body:
    """Drupelets in whorls round a cone, each with its dry style."""
    made, count = [], 74
    for k in range(count):
        v = (k + 0.5) / count
        turn = k * np.pi * (3 - 5**0.5)
        radius = 7.2 * np.sin(np.pi * (0.10 + 0.80 * v)) ** 0.7
        size = 1.75 * random.uniform(0.86, 1.1)
        middle = np.array([radius * np.cos(turn), 15.5 * (v - 0.5), radius * np.sin(turn)])
        tone = 0.14 * random.uniform(0.75, 1.2)
        made.append(ball(middle, size, rings=8, around=14, tone=tone))
        if k % 2:
            out = middle / np.linalg.norm(middle)
            path = (
                middle
                + np.outer([0.95, 1.35, 1.7], out) * size
                + np.outer([0, 0.2, 0.6], random.normal(0, 0.5, 3))
            )
            made.append(tube(path, 0.09, around=5, tone=0.22))
    return joined(made)


def _blueberry(radius: float, random: np.random.Generator) -> Body:
    """A round with a crown on top, and bloom that fingers have rubbed off in places."""
    rings, around = 60, 90
    made = ball((0, 0, 0), (radius, 0.88 * radius, radius), rings=rings, around=around)
    x, y, z = made.vertices.T / radius
    r, turn = np.hypot(x, z), np.arctan2(z, x)
    top = y > 0
    edge = 0.30 + 0.07 * np.cos(5 * turn + random.uniform(0, 6))
    lift = 0.16 * np.exp(-(((r - edge - 0.02) / 0.06) ** 2)) - 0.16 * np.clip((edge - r) / 0.1, 0, 1)
    points = made.vertices + np.stack([0 * r, np.where(top, lift, 0) * radius, 0 * r], axis=1)
    bloom = np.clip(0.5 + cloudy((rings + 1, around + 1), 6, 4, random), 0, 1).ravel()
    tone = np.where(top & (r < edge), 0.05, 0.045 + 0.17 * bloom * np.clip(1.3 - 0.4 * np.abs(y), 0, 1))
    tone *= 1 + 0.15 * noise((rings + 1, around + 1), (rings / 2, around / 2), random).ravel()
    return made._replace(vertices=points, tone=np.clip(tone, 0.03, 0.3))


def thyme(side: float, random: np.random.Generator) -> Body:
    """Two sprigs, one before the target, one beside it; pairs of leaves, each pair across the last."""
    made = []
    for start, way, length in (((-38, 3, 40), (1, 0.02, -0.1), 58), ((34, 3, 14), (0.25, 0.05, 1), 42)):
        start, way = np.array(start, dtype=float), np.array(way) / np.linalg.norm(way)
        wave = np.linspace(0, 1, 8)
        aside = np.cross(way, [0, 1, 0])
        knots = (
            start
            + np.outer(wave * length, way)
            + np.outer(2.5 * np.sin(4 * wave + random.uniform(0, 6)), aside)
        )
        path = rounded(knots, steps=4)
        made.append(tube(path, np.linspace(0.6, 0.3, len(path)), around=8, tone=0.10))
        for k in range(2, len(path), 2):
            for sign in (-1, 1):
                out = (sign * aside if k % 4 else np.array([0, sign * 0.7 + 0.3, 0])) + 0.7 * way
                out = out / np.linalg.norm(out) + random.normal(0, 0.15, 3)
                size = 3.4 * random.uniform(0.8, 1.2) * (1.1 - 0.5 * k / len(path))
                leaf = path[k] + np.outer(np.linspace(0, 1, 6) * size, out)
                leaf[:, 1] = np.maximum(leaf[:, 1], 0.5)
                girth = 0.9 * np.sin(np.linspace(0.25, np.pi - 0.15, 6))
                made.append(tube(leaf, girth, around=8, flat=0.35, tone=random.uniform(0.07, 0.16)))
    return placed(joined(made), scale=(side, 1, 1))


def crumbs(random: np.random.Generator) -> Body:
    """Crumbs of crust and cheese, and poppy seeds."""
    made = []
    for _ in range(230):
        size = float(random.lognormal(np.log(0.45), 0.5))
        x, z = random.normal(0, 34), random.normal(-5, 36)
        body = ball(
            (0, 0, 0),
            size * random.uniform(0.6, 1.2, 3),
            rings=5,
            around=8,
            tone=random.choice([0.04, 0.2, 0.45, 0.6]),
        )
        body = body._replace(
            vertices=body.vertices * (1 + 0.15 * random.standard_normal((len(body.vertices), 1)))
        )
        made.append(placed(body, (x, 0.6 * size, z)))
    return joined(made)
