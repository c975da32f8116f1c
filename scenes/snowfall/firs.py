"""Spruces: boughs of twigs with single needles, and the snow that lies on them; metres, y up."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from clay import Clay
from solid_noise import solid_noise
from solids import Body, joined, placed, tube, turning

SNOW, DUSTED, NEEDLE, BARK = 0.82, 0.45, 0.050, 0.11  # reflectances
VIEW = (0.118, 0.075)  # half of what the lens sees, across and up, for each metre of distance


class Tree(NamedTuple):
    """Needles, each a triangle; those that are dusted with snow; wood; snow."""

    needles: Body
    dusted: Body
    wood: Body
    load: Body

    def placed(self, shift: np.ndarray, *, turn: np.ndarray, scale: float = 1.0) -> Tree:
        return Tree(*(placed(part, shift, turn=turn, scale=scale) for part in self))


def together(trees: list[Tree]) -> Tree:
    return Tree(*(joined(list(parts)) for parts in zip(*trees, strict=True)))


def bough(
    long: float, random: np.random.Generator, *, needle_m: float, step_m: float, twig_m: float, cell_m: float
) -> Tree:
    """A bough from the origin along +x: it sags under its load, its twigs lie in a spray, smaller to the tip.

    needle_m : length of a needle. step_m : from one needle to the next. twig_m : from one twig to the next.
    cell_m : how fine the snow is.
    """
    t = np.linspace(0, 1, 40)
    sway = 0.03 * long * np.sin(3 * t + random.uniform(0, 6)) * t
    axis = long * np.stack([0.97 * t, -0.42 * t**2 + 0.20 * t**4 + 0.03 * t, sway / long], axis=1)
    lines, small = [(axis, 0.008 * long)], []
    for k, share in enumerate(np.arange(0.14, 0.96, twig_m / long)):
        for side in (-1, 1):
            at = min(share + 0.4 * twig_m / long * (k % 2) + random.normal(0, 0.008), 0.97)
            size = long * 0.44 * (1 - at) ** 0.75 * np.clip(at * 5, 0.3, 1) * random.uniform(0.7, 1.1) + 0.03
            twig = _twig(axis, at, side * random.uniform(0.8, 1.1), size, random)
            lines.append((twig, 0.0030))
            if size > 2.5 * twig_m:
                for inner in np.arange(0.25, 0.92, 1.0 * twig_m / size):
                    for way in (-1, 1):
                        short = 0.42 * size * (1 - inner) * random.uniform(0.6, 1.1) + 0.02
                        small.append(_twig(twig, inner, way * 0.8, short, random))
    wood = [tube(p[::3], np.linspace(r, 0.4 * r, len(p[::3])), around=4, tone=BARK) for p, r in lines]
    paths = [path for path, _ in lines]
    needles, dusted = _needles(paths + small, needle_m, step_m, random)
    return Tree(needles, dusted, joined(wood), _load(paths, long, cell_m, random))


def _twig(parent: np.ndarray, share: float, angle: float, size: float, random: np.random.Generator) -> np.ndarray:
    """A path that leaves its parent aside by an angle and bends forward and down."""
    k = int(share * (len(parent) - 2))
    along = parent[k + 1] - parent[k]
    along = along / np.linalg.norm(along)
    out = turning([0, 1, 0], np.degrees(angle)) @ along
    t = np.linspace(0, 1, 12)[:, None]
    path = parent[k] + size * (t * out + 0.18 * t**2 * along)
    return path + size * t * random.normal(0, 0.05, 3) + size * np.array([0, -1, 0]) * (0.05 * t + 0.20 * t**2)


def _needles(paths: list[np.ndarray], long: float, step: float, random: np.random.Generator) -> tuple[Body, Body]:
    """Needles all round the twigs, but more above; and those of them that are dusted with snow."""
    roots, ways = [], []
    for path in paths:
        piece = np.linalg.norm(np.diff(path, axis=0), axis=1)
        way = np.concatenate([[0], np.cumsum(piece)])
        at = np.arange(0, way[-1], step) + random.uniform(0, step)
        at = at[at < way[-1]]
        roots.append(np.stack([np.interp(at, way, path[:, i]) for i in range(3)], axis=1))
        k = np.clip(np.searchsorted(way, at) - 1, 0, len(piece) - 1)
        ways.append((np.diff(path, axis=0) / piece[:, None])[k])
    root, along = np.concatenate(roots), np.concatenate(ways)
    out = random.normal((0, 0.35, 0), 1, root.shape)
    out -= (out * along).sum(axis=1, keepdims=True) * along
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    lean = random.uniform(0.5, 1.2, (len(root), 1))
    needle = out + lean * along
    needle /= np.linalg.norm(needle, axis=1, keepdims=True)
    needle *= long * random.uniform(0.7, 1.15, (len(root), 1))
    side = np.cross(needle, random.normal(0, 1, root.shape))
    side *= 0.055 * long / np.linalg.norm(side, axis=1, keepdims=True)
    points = np.stack([root - side, root + side, root + needle], axis=1)
    white = solid_noise(root, 0.05, random, octaves=2) + 0.25 * random.standard_normal(len(root)) > 0.72
    white &= out[:, 1] > -0.1
    return _triangles(points[~white]), _triangles(points[white])


def _triangles(points: np.ndarray) -> Body:
    corners = points.reshape(-1, 3)
    return Body(corners, np.arange(len(corners)).reshape(-1, 3), np.zeros((len(corners), 2)), np.zeros(len(corners)))


def _load(paths: list[np.ndarray], long: float, cell: float, random: np.random.Generator) -> Body:
    """Pads of snow along the twigs; much of it has slid off."""
    knots = np.concatenate([path[::2] for path in paths])
    kept = solid_noise(knots, 0.13 * long, random, octaves=2) > 0.02
    clay = Clay(knots.min(axis=0) - 0.06, knots.max(axis=0) + 0.08, cell=cell)
    for knot in knots[kept]:
        wide = long * random.uniform(0.014, 0.028)
        centre = knot + [0, 0.35 * wide + 0.004, 0] + random.normal(0, 0.25 * wide, 3) * [1, 0.3, 1]
        clay.ball(centre, (wide, 0.55 * wide, wide), blend=0.8 * wide)
    points, triangles = clay.mesh()
    points = points + 0.004 * np.stack([solid_noise(points, 0.03, random, octaves=2) for _ in range(3)], axis=1)
    return Body(points, triangles, np.zeros((len(points), 2)), np.full(len(points), SNOW))


def tree(
    boughs: list[Tree], high: float, foot: np.ndarray, *, turn: np.ndarray, random: np.random.Generator
) -> list[Tree]:
    """The boughs and the trunk of a tree, without what lies far out of the lens's view.

    boughs : of length 1 m, to be turned and scaled.
    """
    made, y = [], 0.1 * high
    while y < high - 0.05:
        share = 1 - y / high
        long = 0.36 * high * share**0.85 * random.uniform(0.9, 1.1)
        count, first = random.integers(5, 8), random.uniform(0, 360)
        for k in range(count):
            azimuth = first + 360 * (k + random.normal(0, 0.12)) / count
            rise = 25 - 38 * share + random.normal(0, 5)
            way = turn @ turning([0, 1, 0], azimuth) @ turning([0, 0, 1], rise)
            size, kind = long * random.uniform(0.85, 1.1), random.integers(len(boughs))
            at = foot + np.array([0, y, 0])
            if _is_seen(at + 0.5 * size * way[:, 0], 0.55 * size):
                made.append(boughs[kind].placed(at, turn=way, scale=size))
        y += random.uniform(0.09, 0.14) * high**0.5
    knots = np.array([[0, 0, 0], [0, high / 3, 0], [0, 2 * high / 3, 0], [0, high, 0]])
    trunk = tube(knots + foot, np.linspace(0.022 * high, 0.004, 4), around=10, tone=BARK)
    nothing = Body(np.zeros((0, 3)), np.zeros((0, 3), dtype=int), np.zeros((0, 2)), np.zeros(0))
    return [*made, Tree(nothing, nothing, trunk, nothing)]


def _is_seen(middle: np.ndarray, radius: float) -> bool:
    """Whether a ball is within the view of the lens at the origin, or close to it."""
    half = -middle[2] * np.array(VIEW) + radius + 0.1
    return bool((np.abs(middle[:2]) < half).all())
