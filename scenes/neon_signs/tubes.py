"""Bent glass tubes: strokes with round bends, cut into straight lit pieces, and what holds and feeds them.

In the plane of the sign: metres, x right, y up, z from the board towards the lens.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np
from solids import Body, placed, rounded, tube, turned, turning

RADIUS, STANDS_OFF = 0.0070, 0.045  # of a tube, and from the board to its middle
BEND = 0.016  # radius of a bend at the least
BLACK, GLASS, STEEL, RUBBER, WIRE = 0.025, 0.45, 0.30, 0.04, 0.05  # reflectances
STEP = 0.0015  # between the points of a centre line
FADE = 0.010  # by which a tube is dim beside its electrode
AROUND, ALONG = 32, 4  # texels of the radiance of a piece

# Strokes of a letter 4 wide and 6 high: corners with the radius of the bend there. A stroke is one lit path.
LETTERS = {
    "A": ["0 0 0|1.7 5.2 .6|2 6 .4|2.3 5.2 .6|4 0 0", "0.75 2.1 0|3.25 2.1 0"],
    "B": ["0.1 3.15 0|2.6 3.15 .8|3.6 3.4 .9|3.6 5.9 1.3|0 6 .5|0 0 .5|4 0 1.4|4 2.7 1.3|2.3 2.7 .3"],
    "C": ["4 4.6 0|4 6 1.6|0 6 2|0 0 2|4 0 1.6|4 1.4 0"],
    "E": ["4 6 0|0 6 .6|0 0 .6|4 0 0", "0.6 3.1 0|3.2 3.1 0"],
    "F": ["4 6 0|0 6 .6|0 0 0", "0.6 3.0 0|3.1 3.0 0"],
    "H": ["0 6 0|0 0 0", "4 6 0|4 0 0", "0.6 3 0|3.4 3 0"],
    "I": ["2 6 0|2 0 0"],
    "J": ["3.4 6 0|3.4 0 1.7|0 0 1.7|0 1.8 0"],
    "L": ["0 6 0|0 0 .6|3.8 0 0"],
    "M": ["0 0 0|0 6 .35|2.2 1.6 .5|4.4 6 .35|4.4 0 0"],
    "N": ["0 0 0|0 6 .35|4 0 .35|4 6 0"],
    "O": ["2 6 0|0 6 2|0 0 2|4 0 2|4 6 2|2.25 6 0"],
    "P": ["0 0 0|0 6 .6|4 6 1.55|4 2.9 1.55|0.7 2.9 0"],
    "R": ["0 0 0|0 6 .6|4 6 1.5|4 3 1.5|1.5 3 .35|4 0 0"],
    "T": ["0 6 0|4 6 0", "2 5.4 0|2 0 0"],
    "Z": ["0.1 6 0|4 6 .4|0 0 .4|4 0 0"],
}
PITCH = 5.7  # from letter to letter


class Piece(NamedTuple):
    """A straight lit piece: its ends in the plane of the sign, and the brightness at each."""

    start: np.ndarray
    stop: np.ndarray
    bright: tuple[float, float]
    path: int
    """Number of the path to which it belongs."""


def word(text: str, height: float, slant: float) -> list[np.ndarray]:
    """Centre lines of a word's lit strokes, smooth curves (n, 2), its middle at the origin."""
    scale = height / 6
    left = -(PITCH * (len(text) - 1) + 4) / 2
    paths = []
    for place, letter in enumerate(text):
        for stroke in LETTERS[letter]:
            corners = np.array([[float(v) for v in corner.split()] for corner in stroke.split("|")])
            points = bent((corners[:, :2] - [0, 3] + [left + PITCH * place, 0]) * scale, corners[:, 2] * scale)
            paths.append(points + np.stack([slant * points[:, 1], 0 * points[:, 1]], axis=1))
    return paths


def bent(corners: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """A path (n, 2) along corners, each rounded by an arc of its radius, or as wide as there is room."""
    made = [corners[0]]
    for a, b, c, radius in zip(corners, corners[1:], corners[2:], radii[1:-1], strict=False):
        back, on = (a - b) / np.linalg.norm(a - b), (c - b) / np.linalg.norm(c - b)
        half = np.arccos(np.clip(back @ on, -1, 1)) / 2
        room = 0.5 * min(np.linalg.norm(a - b), np.linalg.norm(c - b))
        cut = min(max(radius, BEND) / np.tan(half), room)
        r = cut * np.tan(half)
        middle = b + (back + on) / np.linalg.norm(back + on) * r / np.sin(half)
        first, last = b + cut * back - middle, b + cut * on - middle
        turn = np.arctan2(first[0] * last[1] - first[1] * last[0], first @ last)
        steps = max(int(r * abs(turn) / STEP), 4)
        a_ = np.linspace(0, turn, steps + 1)
        made += list(middle + np.stack([np.cos(a_), np.sin(a_)], axis=1) @ np.array([first, [-first[1], first[0]]]))
    path = np.array([*made, corners[-1]])
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0, way[-1], max(round(way[-1] / STEP), 6) + 1)
    return np.stack([np.interp(at, way, path[:, k]) for k in (0, 1)], axis=1)


def loop(size: tuple[float, float], kind: str) -> list[np.ndarray]:
    """A border: a rounded frame with a gap for its electrodes below, an oval, or a star."""
    w, h = size
    if kind == "frame":
        corners = np.array([(0.018, -h), (w, -h), (w, h), (-w, h), (-w, -h), (-0.018, -h)])
        return [bent(corners, np.full(6, 0.055))]
    a = np.linspace(0.03, 2 * np.pi - 0.03, 400) - np.pi / 2
    if kind == "oval":
        return [np.stack([w * np.cos(a), h * np.sin(a)], axis=1)]
    a = np.linspace(0, 2 * np.pi, 11)[:, None] - np.pi / 2
    reach = np.where(np.arange(11)[:, None] % 2, 1.0, 0.45)
    corners = np.concatenate([w * reach * np.cos(a), h * reach * np.sin(a)], axis=1)
    corners[-1] += [-0.012, 0.0]
    corners[0] += [0.012, 0.0]
    return [bent(corners, np.full(11, 0.016))]


def cut(paths: list[np.ndarray], count: int, random: np.random.Generator) -> list[Piece]:
    """Exactly so many straight pieces of paths: wherever a path bends most, it is cut next."""
    spans = [(k, 0, len(path) - 1) for k, path in enumerate(paths)]
    errors = [_error(paths[k], a, b) for k, a, b in spans]
    while len(spans) < count:
        worst = int(np.argmax([error for error, _ in errors]))
        (k, a, b), (_, m) = spans[worst], errors[worst]
        spans[worst : worst + 1] = [(k, a, m), (k, m, b)]
        errors[worst : worst + 1] = [_error(paths[k], a, m), _error(paths[k], m, b)]
    ways = [np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))]) for path in paths]
    waves = [random.uniform(0, 2 * np.pi, 3) for _ in paths]

    def bright(k: int, at: int) -> float:
        s, long = ways[k][at], ways[k][-1]
        ends = 1 - 0.4 * np.exp(-s / FADE) - 0.4 * np.exp(-(long - s) / FADE)
        wave = sum(np.sin(f * s / 0.1 + phase) for f, phase in zip((1.1, 2.3, 5.1), waves[k], strict=True))
        return float(ends * (1 + 0.05 * wave))

    made = []
    for k, a, b in spans:
        start, stop = paths[k][a], paths[k][b]
        along = (stop - start) / np.linalg.norm(stop - start)
        more = [0.0, 0.0]
        for side, (at, other) in enumerate(((a, a - 1), (b, b + 1))):
            if 0 <= other < len(paths[k]):  # a little longer, so that bends are closed
                step = _neighbour(spans, k, at, side, paths)
                more[side] = RADIUS * np.tan(0.5 * np.arccos(np.clip(along @ step, -1, 1)))
        made.append(Piece(start - more[0] * along, stop + more[1] * along, (bright(k, a), bright(k, b)), k))
    return made


def _neighbour(spans: list[tuple[int, int, int]], k: int, at: int, side: int, paths: list[np.ndarray]) -> np.ndarray:
    """The direction of the piece that meets another at a point of its path."""
    _, a, b = next(span for span in spans if span[0] == k and span[2 - side] == at)
    step = paths[k][b] - paths[k][a]
    return step / np.linalg.norm(step)


def _error(path: np.ndarray, a: int, b: int) -> tuple[float, int]:
    """How far a path bends away from the straight line between two of its points, and where."""
    if b - a < 2:
        return -1.0, a
    chord = path[b] - path[a]
    long = max(float(np.linalg.norm(chord)), 1e-9)
    inner = path[a + 1 : b] - path[a]
    off = np.abs(inner[:, 0] * chord[1] - inner[:, 1] * chord[0]) / long
    if off.max() < 1e-6:
        return 1e-9 * long, (a + b) // 2
    return float(off.max()) + 1e-4 * long, a + 1 + int(np.argmax(off))


def lit(piece: Piece, turn: np.ndarray, at: np.ndarray, radiance: float) -> dict[str, Any]:
    """A cylinder whose light is stronger where one looks deep into it, and dim at its rim."""
    start, stop = (turn @ [*p, STANDS_OFF] + at for p in (piece.start, piece.stop))
    along = stop - start
    long = np.linalg.norm(along)
    along = along / long
    front = turn @ np.array([0, 0, 1.0])
    side = np.cross(along, front)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = RADIUS * front, RADIUS * side, long * along, start
    angle = 2 * np.pi * (np.arange(AROUND) + 0.5) / AROUND
    profile = 0.42 + 0.74 * np.abs(np.cos(angle)) ** 1.5  # about 1 on average over what is seen
    grey = radiance * np.outer(np.linspace(*piece.bright, ALONG), profile)
    picture = mi.Bitmap(np.ascontiguousarray(grey, dtype=np.float32))
    return {
        "type": "cylinder",
        "to_world": mi.ScalarTransform4f(pose),
        "bsdf": {"type": "diffuse", "reflectance": 0.3},
        "emitter": {
            "type": "area",
            "radiance": {"type": "bitmap", "bitmap": picture, "raw": True, "wrap_mode": "clamp"},
        },
    }


def fittings(paths: list[np.ndarray], outlet: np.ndarray, random: np.random.Generator) -> list[Body]:
    """What is not lit, in the sign's axes: tubes bent back and blacked out, electrodes, clips, wires.

    outlet : (x, y) where the wires leave the board.
    """
    parts: list[Body] = []
    for path in paths:
        for end, inner in ((path[0], path[4]), (path[-1], path[-5])):
            out = (end - inner) / np.linalg.norm(end - inner)
            knots = [
                (0.0, STANDS_OFF),
                (0.5 * BEND, STANDS_OFF - 0.1 * BEND),
                (0.95 * BEND, STANDS_OFF - 0.9 * BEND),
                (BEND, 0.006),
            ]
            back = rounded([[*(end + out * s), z] for s, z in knots])
            parts.append(tube(back, 1.03 * RADIUS, around=16, tone=BLACK))
            foot = [*(end + out * BEND), 0.0]
            boot = turned([(0.013, 0), (0.0125, 0.012), (0.0095, 0.022), (0.0085, 0.026)], around=20, tone=RUBBER)
            parts.append(placed(boot, foot, turn=turning([1, 0, 0], 90)))
        parts += _clips(path)
    for first, second in pairwise(paths):
        gap = second[0] - first[-1]
        if np.linalg.norm(gap) < 0.12:  # one tube goes on behind the board's face, painted black
            out = (first[-1] - first[-4]) / np.linalg.norm(first[-1] - first[-4])
            into = (second[0] - second[3]) / np.linalg.norm(second[0] - second[3])
            a, b = first[-1] + out * BEND, second[0] + into * BEND
            sag = rounded([[*a, 0.012], [*(a + 0.3 * (b - a)), 0.017], [*(a + 0.7 * (b - a)), 0.017], [*b, 0.012]])
            parts.append(tube(sag, 0.9 * RADIUS, around=14, tone=BLACK))
    for end in (paths[0][0], paths[-1][-1]):
        mid = (end + outlet) / 2 + random.normal(0, 0.012, 2)
        knots = [[*end, 0.008], [end[0] + 0.004, end[1] - 0.03, 0.006], [*mid, 0.006], [*outlet, 0.008]]
        parts.append(tube(rounded(knots), 0.0035, around=10, tone=WIRE))
    return parts


def _clips(path: np.ndarray) -> list[Body]:
    """Posts of glass on little feet, with a wire about the tube, every 16 cm of a path."""
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    count = max(round(way[-1] / 0.16), 1)
    parts = []
    for s in (np.arange(count) + 0.5) / count * way[-1]:
        k = min(int(np.searchsorted(way, s)), len(path) - 2)
        part = (s - way[k - 1]) / max(way[k] - way[k - 1], 1e-9) if k else 0.0
        x, y = path[k - 1] + part * (path[k] - path[k - 1]) if k else path[0]
        post = turned(
            [(0.009, 0), (0.009, 0.004), (0.004, 0.006), (0.0038, 0.034), (0.0065, 0.037)], around=16, tone=GLASS
        )
        parts.append(placed(post, (x, y, 0), turn=turning([1, 0, 0], 90)))
        along = (path[k] - path[k - 1]) / np.linalg.norm(path[k] - path[k - 1])
        across = np.array([-along[1], along[0]])
        a = np.linspace(0, 2 * np.pi, 15)[:, None]
        ring = (RADIUS + 0.0008) * (np.cos(a) * np.array([*across, 0]) + np.sin(a) * np.array([0, 0, 1.0]))
        parts.append(tube(ring + np.array([x, y, STANDS_OFF]), 0.0009, around=6, tone=STEEL))
    return parts
