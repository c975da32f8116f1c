"""What stands on the pavements: lamps, bollards, signs, goods before a shop, trees; life-size metres."""

from __future__ import annotations

import numpy as np
from ground import END_Z, KERB, ZEBRA_X
from meshes import Body, body, box, quad, tube, turned


def furniture(random: np.random.Generator) -> list[Body]:
    made: list[Body] = []
    for x, z, turn in ((-2.2, -4.3, 0), (8.7, -4.3, 180), (-2.1, -34, 0), (8.6, -52, 180), (-2.1, -74, 0)):
        made += _lamp_post(x, z, turn)
    made += _lamp_post(3.55, 13.4, 180, basket=True)
    for x in np.arange(-9.5, 10, 1.9):
        if not ZEBRA_X[0] < x < ZEBRA_X[1]:
            made += _bollard(float(x), 4.05)
    for x, z in ((-6.6, -3.9), (-3.1, 3.95), (-2.0, -8.6)):
        made += _crossing_sign(x, z)
    made.append(turned([(0, 0.95), (0.24, 0.95), (0.27, 0.80), (0.25, 0.1), (0, 0.1)], (6.3, KERB, 4.6), tone=0.06))
    made.append(box((-9.0, KERB + 0.42, -6.1), (-7.3, KERB + 0.47, -5.65), 0.20))
    made += [box((x, KERB, -6.1), (x + 0.08, KERB + 0.42, -5.65), 0.05) for x in (-8.9, -7.5)]
    for k in range(3):  # goods before a shop
        left = -6.9 + 0.8 * k
        made.append(box((left, KERB + 0.35, -6.45), (left + 0.7, KERB + 0.72, -5.95), 0.24))
        tones = random.uniform(0.12, 0.55, 24)
        made += [
            turned(
                [(0, 0.1), (0.05, 0.05), (0, 0)],
                (left + 0.09 + 0.1 * (n % 6), KERB + 0.68, -6.38 + 0.11 * (n // 6)),
                around=7,
                tone=tone,
            )
            for n, tone in enumerate(tones)
        ]
    return made


def _lamp_post(x: float, z: float, turn: float, *, basket: bool = False) -> list[Body]:
    post = turned([(0.11, 0), (0.11, 0.9), (0.075, 1.0), (0.05, 6.4), (0.04, 6.5)], (0, KERB, 0), around=14, tone=0.10)
    arm = tube([(0, 6.5, 0), (0.35, 6.9, 0), (1.1, 7.05, 0)], 0.035, tone=0.10)
    head = box((0.95, 6.92, -0.15), (1.75, 7.06, 0.15), 0.35)
    parts = [
        post,
        arm,
        head,
        box((-0.14, 2.5, 0.07), (0.14, 2.95, 0.09), 0.55),
        box((-0.1, 2.6, 0.09), (0.1, 2.85, 0.095), 0.08),
    ]
    if basket:
        leaves = np.random.default_rng(5)
        at = leaves.normal(0, 1, (420, 3)) * [0.24, 0.17, 0.24] + [0.55, 3.95, 0]
        parts.append(_leaves(at, 0.055, leaves))
        parts.append(tube([(0, 4.3, 0), (0.3, 4.42, 0), (0.55, 4.3, 0)], 0.02, tone=0.05))
    return [part.moved((x, 0, z), turn) for part in parts]


def _bollard(x: float, z: float) -> list[Body]:
    outline = [
        (0.075, 0),
        (0.075, 0.66),
        (0.076, 0.661),
        (0.076, 0.76),
        (0.075, 0.761),
        (0.075, 0.88),
        (0.06, 0.95),
        (0, 0.97),
    ]
    tones = [0.05, 0.05, 0.65, 0.65, 0.05, 0.05, 0.05, 0.05]
    return [turned(outline, (x, KERB, z), around=14, tone=tones)]


def _crossing_sign(x: float, z: float) -> list[Body]:
    """A square plate: a white triangle with a walker on it."""
    pole = tube([(x, KERB, z), (x, 1.5, z), (x, 3.0, z)], 0.032, tone=0.4)
    w = 0.32
    plate = box((x - w, 2.35, z + 0.03), (x + w, 2.99, z + 0.045), 0.10)
    front = z + 0.052
    white = body([(x - 0.26, 2.42, front), (x + 0.26, 2.42, front), (x, 2.92, front)], [[0, 1, 2]], tone=0.75)
    figure = [quad(*[(x + u, 2.42 + v, front + 0.006) for u, v in q], tone=0.03) for q in _FIGURE]
    return [pole, plate, white, *figure]


_FIGURE = [
    [(-0.02, 0.27), (0.02, 0.27), (0.02, 0.32), (-0.02, 0.32)],
    [(-0.035, 0.15), (0.03, 0.15), (0.03, 0.26), (-0.03, 0.26)],
    [(-0.10, 0.02), (-0.05, 0.02), (0.01, 0.15), (-0.03, 0.15)],
    [(0.05, 0.02), (0.09, 0.02), (0.03, 0.15), (-0.01, 0.15)],
]


def trees(random: np.random.Generator) -> list[Body]:
    made = []
    spots = [(-2.5, -22.0, 5.2), (9.0, -30.0, 5.6), (-2.5, -46.0, 6.0), (9.0, -64.0, 6.5), (-2.5, -90.0, 6.0)]
    spots += [(float(x), END_Z - 3, 6.5) for x in (-8.0, 13.0, 19.0)]
    for x, z, high in spots:
        made.append(tube([(x, 0, z), (x + 0.1, 2, z), (x, high * 0.8, z)], [0.16, 0.12, 0.06], tone=0.10))
        count = 1500
        middle = random.normal(0, 1, (22, 3)) * [0.75, 0.8, 0.75] + [x, high, z]
        at = middle[random.integers(0, 22, count)] + random.normal(0, 0.36, (count, 3))
        made.append(_leaves(at, 0.15, random))
    return made


def _leaves(at: np.ndarray, size: float, random: np.random.Generator) -> Body:
    """Little kites about these points, turned every way; each stands for a tuft of leaves."""
    count = len(at)
    across, along = (random.normal(0, 1, (count, 1, 3)) for _ in range(2))
    across /= np.linalg.norm(across, axis=2, keepdims=True)
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    shape = np.array([[0, -1], [0.55, 0], [0, 1], [-0.55, 0]])
    spread = size * random.uniform(0.6, 1.3, (count, 1, 1))
    points = at[:, None] + spread * (shape[None, :, :1] * across + shape[None, :, 1:] * along)
    first = 4 * np.arange(count)[:, None]
    triangles = np.concatenate([first + np.array(half) for half in ((0, 1, 2), (0, 2, 3))])
    tone = np.repeat(random.uniform(0.08, 0.28, count), 4)
    return body(points.reshape(-1, 3), triangles, tone=tone)
