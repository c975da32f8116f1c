"""Spruces: boughs of twigs with single needles, and the snow that lies on them; metres, y up."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from clay import Clay
from solid import solid_noise
from solids import Body, joined, placed, tube, turning

SNOW, NEEDLE, BARK = 0.82, 0.050, 0.11  # reflectances


class Tree(NamedTuple):
    """Needles, each a triangle; wood; snow."""

    needles: Body
    wood: Body
    snow: Body

    def placed(self, shift: np.ndarray, *, turn: np.ndarray, scale: float = 1.0) -> Tree:
        return Tree(*(placed(part, shift, turn=turn, scale=scale) for part in self))


def together(trees: list[Tree]) -> Tree:
    return Tree(*(joined(list(parts)) for parts in zip(*trees, strict=True)))


def bough(long: float, random: np.random.Generator, *, needle_m: float, step_m: float, twig_m: float) -> Tree:
    """A bough from the origin along +x: it sags under its load, its twigs lie in a spray, smaller to the tip.

    needle_m : length of a needle. step_m : from one needle to the next. twig_m : from one twig to the next.
    """
    t = np.linspace(0, 1, 40)
    sway = 0.03 * long * np.sin(3 * t + random.uniform(0, 6)) * t
    axis = long * np.stack([0.97 * t, -0.42 * t**2 + 0.20 * t**4 + 0.03 * t, sway / long], axis=1)
    lines = [(axis, 0.009 * long)]
    for k, share in enumerate(np.arange(0.14, 0.96, twig_m / long)):
        for side in (-1, 1):
            at = min(share + 0.4 * twig_m / long * (k % 2) + random.normal(0, 0.008), 0.97)
            size = long * 0.44 * (1 - at) ** 0.75 * np.clip(at * 5, 0.3, 1) * random.uniform(0.7, 1.1) + 0.03
            twig = _twig(axis, at, side * random.uniform(0.8, 1.1), size, random)
            lines.append((twig, 0.0030))
            if size > 2.5 * twig_m:
                for inner in np.arange(0.3, 0.9, 1.25 * twig_m / size):
                    for way in (-1, 1):
                        small = 0.42 * size * (1 - inner) * random.uniform(0.6, 1.1) + 0.02
                        lines.append((_twig(twig, inner, way * 0.8, small, random), 0.0018))
    wood = [
        tube(
            path[::4] if len(path) > 20 else path,
            np.linspace(r, 0.4 * r, len(path[::4] if len(path) > 20 else path)),
            around=5,
            tone=BARK,
        )
        for path, r in lines
    ]
    return Tree(
        _needles([path for path, _ in lines], needle_m, step_m, random),
        joined(wood),
        _load(lines, long, random),
    )


def _twig(
    parent: np.ndarray, share: float, angle: float, size: float, random: np.random.Generator
) -> np.ndarray:
    """A path that leaves its parent aside by an angle and bends forward and down."""
    k = int(share * (len(parent) - 2))
    along = parent[k + 1] - parent[k]
    along = along / np.linalg.norm(along)
    out = turning([0, 1, 0], np.degrees(angle)) @ along
    t = np.linspace(0, 1, 12)[:, None]
    path = parent[k] + size * (t * out + 0.18 * t**2 * along)
    return (
        path + size * t * random.normal(0, 0.05, 3) + size * np.array([0, -1, 0]) * (0.05 * t + 0.20 * t**2)
    )


def _needles(paths: list[np.ndarray], long: float, step: float, random: np.random.Generator) -> Body:
    """Needles all round the twigs, but more above; some of them are dusted with snow."""
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
    tone = NEEDLE * random.lognormal(0, 0.3, len(root))
    dusted = solid_noise(root, 0.05, random, octaves=2) + 0.25 * random.standard_normal(len(root)) > 0.75
    tone = np.where(dusted & (out[:, 1] > 0), 0.5, tone)
    order = np.arange(3 * len(root)).reshape(-1, 3)
    return Body(
        points.reshape(-1, 3), order, np.zeros((3 * len(root), 2)), np.repeat(np.clip(tone, 0.02, 0.6), 3)
    )


def _load(lines: list[tuple[np.ndarray, float]], long: float, random: np.random.Generator) -> Body:
    """Pillows of snow along the twigs; some have slid off."""
    knots = np.concatenate([path[:: 3 if r > 0.0025 else 5] for path, r in lines])
    kept = solid_noise(knots, 0.16 * long, random, octaves=2) > -0.28
    cell = 0.0085 * max(long, 0.7)
    low, high = knots.min(axis=0) - 0.06, knots.max(axis=0) + 0.08
    clay = Clay(low, high, cell=cell)
    for knot in knots[kept]:
        wide = long * random.uniform(0.020, 0.036)
        centre = knot + [0, 0.45 * wide, 0] + random.normal(0, 0.2 * wide, 3) * [1, 0.4, 1]
        clay.ball(centre, (wide, 0.58 * wide, wide), blend=0.9 * wide)
    points, triangles = clay.mesh()
    points = points + 0.004 * np.stack(
        [solid_noise(points, 0.03, random, octaves=2) for _ in range(3)], axis=1
    )
    tone = SNOW * (1 + 0.04 * solid_noise(points, 0.02, random, octaves=2))
    return Body(points, triangles, np.zeros((len(points), 2)), np.clip(tone, 0, 0.9))


def tree(boughs: list[Tree], span: tuple[float, float], high: float, random: np.random.Generator) -> Tree:
    """A tree from its foot at the origin: its whorls between two heights, and its trunk.

    boughs : of length 1 m, to be turned and scaled.
    """
    made, y = [], span[0]
    while y < min(span[1], high - 0.05):
        share = 1 - y / high
        long = 0.36 * high * share**0.85 * random.uniform(0.9, 1.1)
        count, first = random.integers(5, 8), random.uniform(0, 360)
        for k in range(count):
            azimuth = first + 360 * (k + random.normal(0, 0.12)) / count
            rise = 25 - 38 * share + random.normal(0, 5)
            turn = turning([0, 1, 0], azimuth) @ turning([0, 0, 1], rise)
            one = boughs[random.integers(len(boughs))]
            made.append(one.placed(np.array([0, y, 0]), turn=turn, scale=long * random.uniform(0.85, 1.1)))
        y += random.uniform(0.10, 0.16) * high**0.5
    all_ = together(made)
    top = np.array([[0, 0, 0], [0, high / 3, 0], [0, 2 * high / 3, 0], [0, high, 0]])
    trunk = tube(top, np.linspace(0.022 * high, 0.004, 4), around=10, tone=BARK)
    return all_._replace(wood=joined([all_.wood, trunk]))
