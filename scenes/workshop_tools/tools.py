"""Tools as bodies, in millimetres, and the rule's face as pictures: float32, row 0 on top."""

from __future__ import annotations

import numpy as np
from clay import Clay
from solids import Body, ball, grid, joined, placed, tube, turned, turning
from stroke_font import drawn, lines
from surfaces import cloudy, noise


def rule_picture(
    size: tuple[float, float], texel: float, *, steel: float, rust: float, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Reflectance and roughness of the rule: half and whole millimetres, numbers, scratches, rust."""
    x, y = ((np.arange(round(side / texel)) + 0.5) * texel - side / 2 for side in size)
    shape = y.size, x.size
    pieces = []
    for k in range(301):
        at = 0.5 * k - size[0] / 2
        long = 7.5 if k % 20 == 0 else 5.5 if k % 10 == 0 else 3.8 if k % 2 == 0 else 2.4
        pieces.append((np.array([at, size[1] / 2 - long]), np.array([at, size[1] / 2])))
        if k % 2 == 0:
            pieces.append((np.array([at, -size[1] / 2]), np.array([at, long - size[1] / 2])))
    ink = drawn(x, y, pieces, 0.17)
    numbers = []
    for k in range(1, 15):
        at = 10 * k - size[0] / 2
        numbers += lines(str(10 * k), 2.9, (at, 3.2)) + lines(str(k), 3.4, (at, -3.0))
    ink = np.maximum(ink, drawn(x, y, numbers, 0.42))[::-1]
    brushed = noise(shape, (shape[0] / 1.5, shape[1] / 60), random)
    spots = rust * np.clip(2.4 * cloudy(shape, 14, 5, random) - 0.9, 0, 1)
    grey = steel * (1 + 0.05 * brushed + 0.06 * cloudy(shape, 8, 4, random))
    alpha = 0.24 + 0.04 * brushed
    for _ in range(70):
        at, a, length = random.uniform(-0.5, 0.5, 2) * size, random.normal(0, 0.5), random.exponential(9)
        way = length * np.array([np.cos(a), np.sin(a)])
        scratch = drawn(x, y, [(at, at + way)], 0.1)
        grey, alpha = grey * (1 - 0.25 * scratch), alpha + 0.12 * scratch
    grey += spots * (0.10 - grey)
    grey += ink * (0.04 - grey)
    alpha = alpha + 0.25 * spots + 0.2 * ink
    return np.clip(grey, 0.03, 0.9).astype(np.float32), np.sqrt(np.clip(alpha, 0.12, 0.7)).astype(np.float32)


def spanner() -> Body:
    """A forged open-ended spanner along x, both jaws 13 to 16 mm wide, 150 mm long, flat on the bench."""
    made = Clay((-92, -7, -24), (92, 7, 24), cell=0.6)
    made.limb([(-58, 0, 0, 4.6), (0, 0, 0, 4.2), (58, 0, 0, 4.6)], blend=3.0)
    for end, wide in ((-1, 17.0), (1, 14.5)):
        made.ball((70 * end, 0, 0), (wide, 4.6, wide * 0.92), blend=7.0)
        mouth = np.array([np.cos(0.26), 0, np.sin(0.26)]) * end
        foot = np.array([70.0 * end, 0, 0]) - 1.0 * mouth
        for y in (-6.0, -2.0, 2.0, 6.0):
            foot[1] = y
            made.limb([(*foot, 0.46 * wide), (*(foot + 30 * mouth), 0.46 * wide)], blend=0.6, cut=True)
    made.limb([(-40, 5.6, 0, 2.0), (40, 5.6, 0, 2.0)], blend=1.0, cut=True)  # the groove of the shank
    vertices, triangles = made.mesh()
    return Body(vertices, triangles, vertices[:, [0, 2]] / 50, np.full(len(vertices), 0.5))


def screwdriver() -> tuple[Body, Body]:
    """A fluted wooden handle and its blade, along x."""
    outline = [
        (0, -50), (6, -50), (11, -47), (12.6, -40), (12.2, -20), (11.8, 0), (10.2, 16), (7.6, 24), (7.4, 28),
        (9.2, 33), (8.8, 38), (0, 38.2),
    ]  # fmt: skip
    tone = np.full((len(outline), 1), 0.30)
    tone[7:9] = 0.05
    handle = turned(outline, around=72, tone=tone)
    v = handle.vertices
    angle = np.arctan2(v[:, 0], v[:, 2])
    flutes = 1 - 0.07 * (np.cos(8 * angle) > 0.6) * ((v[:, 1] > -44) & (v[:, 1] < 12))
    handle = handle._replace(vertices=v * flutes[:, None] ** [1, 0, 1])
    blade = tube(np.array([[0, y, 0] for y in (36, 60, 110, 128)]), np.array([3.0, 3.0, 3.0, 2.6]), around=20)
    tip = placed(ball((0, 0, 0), (4.0, 9.0, 0.7), tone=0.5), [0, 130, 0])
    lie = turning([0, 0, 1], -90)
    return placed(handle, turn=lie), placed(joined([blade, tip]), turn=lie)


def screw() -> Body:
    """A countersunk wood screw, its axis along y, its head on top."""
    thread = [(0.05, 0.0)]
    for k in range(12):
        core = 0.35 + 0.75 * min(k / 5, 1)
        thread += [(core, 0.8 + 1.15 * k), (core + 0.55, 1.3 + 1.15 * k), (core + 0.5, 1.45 + 1.15 * k)]
    head = [(1.3, 15.2), (1.45, 19.0), (3.3, 21.0), (3.35, 21.4), (0.9, 21.4), (0.5, 20.2), (0.0, 20.2)]
    outline = [*thread, *head]
    return placed(turned(outline, around=24), [0, -10, 0])


def shaving(tone: float, random: np.random.Generator) -> Body:
    """A curl from the plane: a strip wound into a spiral that opens, on its side."""
    turns, wide = random.uniform(1.5, 3.0), random.uniform(8, 16)
    a = np.linspace(0, 2 * np.pi * turns, 90)[:, None]
    r = random.uniform(3.0, 4.5) + 0.5 * a / np.pi
    along = np.linspace(-0.5, 0.5, 5)[None, :] * wide
    ragged = 1 + 0.03 * random.standard_normal((90, 1))
    x, y, z = np.broadcast_arrays(r * np.cos(a), r * np.sin(a), along * ragged + 2.2 * a / np.pi)
    points = np.stack([x, y - y.min(), z], axis=2)
    return grid(points, tone=tone * (1 + 0.12 * random.standard_normal((90, 5))))


def pencil() -> Body:
    """A six-sided pencil along x, sharpened, with a printed band."""
    a = np.linspace(0, 2 * np.pi, 7)
    rows, tone = [], []
    paint = [(-70, 3.9, 0.10), (-52, 3.9, 0.10), (-52, 3.9, 0.6), (-49, 3.9, 0.6), (-49, 3.9, 0.10), (50, 3.9, 0.10)]
    for x, r, t in (*paint, (50, 3.8, 0.5), (64, 1.1, 0.5), (64, 1.1, 0.05), (69, 0.1, 0.05)):
        rows.append(np.stack([0 * a + x, r * np.cos(a), r * np.sin(a)], axis=1))
        tone.append([t] * 7)
    return grid(np.array(rows), tone=np.array(tone))
