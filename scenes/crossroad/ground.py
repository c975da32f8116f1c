"""Roads, pavements and kerbs of the crossing, and what is painted on them; life-size metres.

x right, y up, z towards the camera; the middle of the main road is the line z = 0. It runs along x; a
side street leaves it at the far side, between the kerbs x = SIDE[0] and SIDE[1].
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import surfaces
from meshes import Body, body, grid, joined, quad

HALF_ROAD, KERB, SIDE = 3.5, 0.13, (-1.5, 8.0)
HOUSE_Z, HOUSE_X = -6.5, (-3.5, 10.0)  # the lines of the houses on the main road and on the side street
END_Z = -118.0
WIDE = 19.0  # half of the main road's length
FINE_M, NEAR_Z, MOUTH_Z = (0.024, 0.012), 3.5, -13.0  # texel along z and x of the ground in the foreground
ZEBRA_X, ZEBRA_Z = (-6.2, -3.4), (-8.2, -5.2)  # over the main road, over the side street


def _flat(x0: float, x1: float, far: float, near: float, y: float) -> Body:
    """A level rectangle; its picture's top row lies at the far side."""
    points = [(x0, y, near), (x1, y, near), (x1, y, far), (x0, y, far)]
    return quad(*points, uv=[(0, 0), (1, 0), (1, 1), (0, 1)])


def road() -> Body:
    return _flat(-WIDE, WIDE, MOUTH_Z, NEAR_Z, 0.0)


def street() -> Body:
    return _flat(SIDE[0] - 1, SIDE[1] + 1, END_Z, MOUTH_Z, 0.0)


def ground() -> Body:
    return _flat(-150, 150, -260, 60, -0.05)


def road_picture(wear: float, random: np.random.Generator) -> np.ndarray:
    """Asphalt with both zebra crossings, lane lines, give-way marks and manhole covers."""
    rows, columns = int((NEAR_Z - MOUTH_Z) / FINE_M[0]), int(2 * WIDE / FINE_M[1])
    ground = surfaces.asphalt((rows, columns), FINE_M, random)
    z = (MOUTH_Z + (np.arange(rows) + 0.5) * FINE_M[0])[:, None]
    x = ((np.arange(columns) + 0.5) * FINE_M[1] - WIDE)[None, :]
    on_main = np.abs(z) < HALF_ROAD - 0.15
    on_side = (x > SIDE[0] + 0.2) & (x < SIDE[1] - 0.2)
    first = (x > ZEBRA_X[0]) & (x < ZEBRA_X[1]) & on_main & (np.mod(z + 0.25, 1.0) < 0.5)
    second = (z > ZEBRA_Z[0]) & (z < ZEBRA_Z[1]) & on_side & (np.mod(x, 1.0) < 0.5)
    clear = (x < ZEBRA_X[0] - 1) | (x > ZEBRA_X[1] + 1)
    middle = (np.abs(z) < 0.06) & clear & (np.mod(x, 3.0) < 1.6)
    edge = (np.abs(np.abs(z) - HALF_ROAD + 0.35) < 0.05) & ((z > 0) | (x < SIDE[0] - 2) | (x > SIDE[1] + 2)) & clear
    stop = (np.abs(z + 4.4) < 0.16) & (x > SIDE[0] + 2.2) & (x < SIDE[0] + 5.0) & (np.mod(x, 0.9) < 0.6)
    surfaces.worn_paint(ground, first | second | middle | edge | stop, random, wear=wear)
    for at in ((1.8, -1.1), (-8.0, 2.2), (4.4, -9.5), (9.6, -2.3)):
        far = np.hypot(x - at[0], z - at[1])
        ground[far < 0.36] = 0.05
        lid = (far < 0.32) & (np.sin(2 * np.pi * (x - at[0]) / 0.08) * np.sin(2 * np.pi * (z - at[1]) / 0.08) > 0)
        ground[lid] = 0.14
    return ground


def street_picture(wear: float, random: np.random.Generator) -> np.ndarray:
    texel = (0.12, 0.025)
    rows, columns = int((MOUTH_Z - END_Z) / texel[0]), int((SIDE[1] - SIDE[0] + 2) / texel[1])
    ground = surfaces.asphalt((rows, columns), texel, random)
    z, x = np.arange(rows)[:, None] * texel[0], np.arange(columns)[None, :] * texel[1] + SIDE[0] - 1
    dash = (np.abs(x - 3.45) < 0.07) & (np.mod(z, 6.0) < 2.6)
    bays = ((np.abs(x - SIDE[0] - 2.1) < 0.05) | (np.abs(x - SIDE[1] + 2.1) < 0.05)) & (np.mod(z, 1.0) < 0.5)
    surfaces.worn_paint(ground, dash | bays, random, wear=wear)
    return ground


def _corner(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Kerb and house line of a far pavement round the corner, (n, 2) points (x, z); side 0 left, 1 right."""
    sign = (-1, 1)[side]
    x, wall = SIDE[side], HOUSE_X[side]
    centre = np.array([x + sign * 2.0, -HALF_ROAD - 2.0])
    turn = np.linspace(np.pi / 2, np.pi if side else 0, 9)
    arc = centre + 2.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    kerb = [[sign * WIDE, -HALF_ROAD], *arc, [x, END_Z]]
    house_line = [[sign * WIDE, HOUSE_Z], *np.tile([wall, HOUSE_Z], (len(arc), 1)), [wall, END_Z]]
    return np.array(kerb), np.array(house_line)


def _near_kerb() -> tuple[np.ndarray, np.ndarray]:
    return np.array([[WIDE, HALF_ROAD], [-WIDE, HALF_ROAD]]), np.array([[WIDE, 16.0], [-WIDE, 16.0]])


def pavements() -> Body:
    made = []
    for kerb, wall in (_corner(0), _corner(1), _near_kerb()):
        points = np.stack([np.insert(kerb, 1, KERB, axis=1), np.insert(wall, 1, KERB, axis=1)])
        made.append(grid(points, uv=points[:, :, [0, 2]]))
    return joined(made)


def kerbs(random: np.random.Generator) -> Body:
    """Granite stones of 1 m along every kerb, each a little different, a dark gutter at their feet."""
    stones = []
    for kerb, _ in (_corner(0), _corner(1), _near_kerb()):
        for a, b in pairwise(kerb):
            length = float(np.hypot(*(b - a)))
            along = (b - a) / length
            left = np.array([along[1], -along[0]])
            inward = left if _inside(a, left, kerb) else -left
            cuts = np.linspace(0, length, max(round(length), 1) + 1)
            for p, q in pairwise(cuts):
                tone = 0.36 * float(random.uniform(0.75, 1.2))
                outer = [a + along * (p + 0.008), a + along * (q - 0.008)]
                inner = [point + inward * 0.16 for point in outer]
                gutter = [point - inward * 0.30 for point in outer]
                stones.append(_level([*outer, *inner[::-1]], KERB + 0.012, tone))
                face = [(*outer[0], 0.0), (*outer[1], 0.0), (*outer[1], KERB + 0.012), (*outer[0], KERB + 0.012)]
                stones.append(quad(*[(x, y, z) for x, z, y in face], tone=0.7 * tone))
                stones.append(_level([*outer, *gutter[::-1]], 0.004, 0.16 * float(random.uniform(0.7, 1.2))))
    return joined(stones)


def _inside(a: np.ndarray, step: np.ndarray, kerb: np.ndarray) -> bool:
    """Whether a step from the kerb leads away from the road."""
    x, z = a + 0.3 * step
    if kerb[0, 1] > 0:
        return bool(z > HALF_ROAD)
    return bool(z < -HALF_ROAD and not SIDE[0] < x < SIDE[1])


def _level(points: list[np.ndarray], y: float, tone: float) -> Body:
    return body([(x, y, z) for x, z in points], [[0, 1, 2], [0, 2, 3]], tone=tone)
