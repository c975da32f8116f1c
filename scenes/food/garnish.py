"""Grapes, rosemary, crumbs; millimetres, on y = 0."""

from __future__ import annotations

import numpy as np
from solid_noise import solid_noise
from solids import Body, ball, joined, placed, rounded, tube, turning

NEEDLE, STALK = 0.075, 0.16


def grapes(rings: int, random: np.random.Generator) -> tuple[Body, Body]:
    """The berries of a small bunch that lies on the board, and its stalks."""
    count = 15
    radius = random.uniform(6.6, 8.6, count)
    place = random.normal(0, 1, (count, 3)) * [15, 6, 8] + [0, 14, 0]
    for _ in range(300):  # they settle: apart from each other, inwards, down on the board
        place = place * [0.995, 1, 0.992] - [0, 0.10, 0]
        way = place[:, None] - place[None]
        far = np.linalg.norm(way, axis=2) + np.eye(count) * 1e3
        overlap = np.clip(radius[:, None] + radius[None] - 0.2 - far, 0, None)
        place = place + 0.35 * (way / far[..., None] * overlap[..., None]).sum(axis=1)
        place[:, 1] = np.maximum(place[:, 1], 0.97 * radius)
    spine = rounded([[-30, 19, -6], [-14, 20, 1], [1, 19, 4], [14, 13, 5]], steps=6)
    berries, stalks = [], [tube(spine, np.linspace(1.5, 0.8, len(spine)), around=10, tone=STALK)]
    for r, centre in zip(radius, place, strict=True):
        root = spine[np.argmin(np.linalg.norm(spine - centre - [6, 0, 0], axis=1))]
        up = root - centre + random.normal(0, 3, 3)
        up = up / np.linalg.norm(up)
        berries.append(placed(_berry(r, rings, random), centre, turn=_frame(up)))
        path = rounded([centre + 0.93 * r * up, centre + 1.35 * r * up, root], steps=4)
        stalks.append(tube(path, np.linspace(0.75, 0.55, len(path)), around=7, tone=STALK))
    return joined(berries), joined(stalks)


def _frame(up: np.ndarray) -> np.ndarray:
    """A rotation that takes +y to a direction."""
    side = np.cross([0.31, 0.17, 0.94], up)
    side = side / np.linalg.norm(side)
    return np.stack([side, up, np.cross(side, up)], axis=1)


def _berry(radius: float, rings: int, random: np.random.Generator) -> Body:
    """A dark berry, its stalk on +y: bloom that was rubbed off in places and has run, lenticels, a scar."""
    made = ball((0, 0, 0), (radius, 1.12 * radius, radius), rings=rings, around=rings * 3 // 2)
    points = made.vertices
    broad, fine = solid_noise(points, 4.5, random, octaves=3), solid_noise(points, 0.7, random, octaves=3)
    rubbed = np.clip(1.7 * solid_noise(points, 5.0, random, octaves=2) - 0.35, 0, 1)
    worn = np.clip(2.2 - 9 * np.abs(solid_noise(points, (1.0, 6.0, 1.0), random)), 0, 1)
    bloom = np.clip(0.62 + 0.40 * broad + 0.22 * fine, 0, 1) * (1 - 0.85 * rubbed) * (1 - 0.35 * worn)
    speck = np.clip(4 * solid_noise(points, 0.55, random) - 3.0, 0, 1)
    tone = 0.016 + 0.17 * bloom**1.3 + 0.10 * speck
    lat = points[:, 1] / (1.12 * radius)
    tone = np.where(lat > 0.985, 0.14, tone)
    tone = np.where(lat < -0.992, 0.05, tone)
    dent = 1 - 0.035 * np.clip((lat - 0.90) / 0.1, 0, 1) + 0.012 * solid_noise(points, 6.0, random)
    return made._replace(vertices=points * dent[:, None], tone=np.clip(tone, 0.02, 0.3))


def rosemary(start: tuple[float, ...], way: tuple[float, ...], long: float, random: np.random.Generator) -> Body:
    """A sprig on the board: a bending stalk and needles in pairs, each pair turned from the last."""
    start, way = np.array(start, dtype=float), np.array(way) / np.linalg.norm(way)
    aside = np.cross(way, [0, 1, 0])
    at = np.linspace(0, 1, 7)
    bend = 4.0 * np.sin(2.5 * at + random.uniform(0, 6))
    path = rounded(start + np.outer(at * long, way) + np.outer(bend - bend[0], aside), steps=8)
    made = [tube(path, np.linspace(1.1, 0.6, len(path)), around=8, tone=STALK)]
    turn = random.uniform(0, 6)
    for k in np.arange(2, len(path) - 1):
        for _ in range(5):
            turn += 2.4
            along = path[k + 1] - path[k - 1]
            along = along / np.linalg.norm(along)
            out = np.cos(turn) * np.cross(along, [0, 1, 0]) + np.sin(turn) * np.array([0, 1, 0])
            lean = random.uniform(0.5, 1.1) * (0.7 + 0.5 * k / len(path))
            size = random.uniform(7, 11) * (1.0 - 0.35 * (k / len(path)) ** 3)
            s = np.linspace(0, 1, 6)[:, None]
            leaf = path[k] + size * (s * (out + lean * along) / np.hypot(1, lean) + 0.18 * s**2 * along)
            leaf[:, 1] = np.maximum(leaf[:, 1], 0.45)
            girth = 0.62 * np.array([0.5, 0.9, 1.0, 1.0, 0.85, 0.4])
            tone = NEEDLE * random.uniform(0.7, 1.35) * np.array([1.3, 1.1, 1, 1, 1, 1.1])
            made.append(tube(leaf, girth, around=6, flat=0.5, tone=tone))
    return joined(made)


def crumbs(places: list[tuple[float, float, float, int, float]], random: np.random.Generator) -> Body:
    """Crumbs round places: x, z, how far they lie, how many, and their reflectance."""
    made = []
    for x, z, far, count, tone in places:
        for _ in range(count):
            size = float(min(random.lognormal(np.log(0.34), 0.65), 1.9))
            body = ball((0, 0, 0), size * random.uniform(0.6, 1.2, 3), rings=6, around=9)
            rough = 1 + 0.28 * solid_noise(body.vertices, 0.7 * size, random)
            own = tone * random.uniform(0.7, 1.15) if random.random() < 0.8 else 0.13
            body = body._replace(vertices=body.vertices * rough[:, None], tone=np.full(len(body.tone), own))
            off = random.standard_t(3, 2) * 0.5 * far
            turn = turning(random.normal(0, 1, 3), float(random.uniform(0, 360)))
            made.append(placed(body, (x + off[0], 0.55 * size, z + off[1]), turn=turn))
    return joined(made)
