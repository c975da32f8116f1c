"""Hands of clay: palm, fingers bent at their joints, forearm. Millimetres, a right hand that shows its palm.

The wrist is the origin, y leads along the hand, x towards the thumb, z out of the palm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from clay import Clay
from solids import turning

CELL = 1.3
LOW, HIGH = (-78, -120, -32), (104, 206, 92)
# Knuckle (x, y, z), sideways angle (deg), lengths of the three bones, radii at their four ends.
FINGERS = (
    ((25, 91, 0), 8.0, (43, 26, 20), (10.5, 9.3, 8.2, 6.6)),
    ((5, 95, 0), 1.0, (47, 30, 21), (10.6, 9.5, 8.4, 6.8)),
    ((-14, 90, -1), -6.0, (44, 28, 21), (10.0, 8.9, 7.9, 6.4)),
    ((-31, 79, -3), -15.0, (35, 20, 18), (9.0, 7.8, 6.9, 5.6)),
)
FLAT, FOLDED = (4.0, 5.0, 4.0), (76.0, 100.0, 58.0)  # bends of the three joints, deg
THUMB_OUT = ((43, 52, 10), (64, 79, 12), (76, 105, 10))  # its knuckle, its joint, its tip
THUMB_OVER = ((42, 50, 20), (32, 74, 42), (10, 85, 55))
THUMB_MET = ((46, 54, 22), (47, 82, 44), (31, 103, 66))  # with the tip of the forefinger
GESTURES = {
    "open": (THUMB_OUT, (FLAT, FLAT, FLAT, FLAT)),
    "point": (THUMB_OVER, (FLAT, FOLDED, FOLDED, FOLDED)),
    "two": (THUMB_OVER, (FLAT, FLAT, FOLDED, FOLDED)),
    "ring": (THUMB_MET, ((45, 55, 25), (14, 12, 8), (8, 8, 6), FLAT)),
    "cupped": (THUMB_OUT, ((26, 30, 18), (28, 32, 20), (30, 32, 20), (30, 34, 22))),
}


@dataclass(frozen=True)
class Hand:
    """The surface, and the middle line of each finger, thumb first: (4, 3) joints with radii (4,)."""

    vertices: np.ndarray
    triangles: np.ndarray
    fingers: list[tuple[np.ndarray, np.ndarray]]


def hand(gesture: str, random: np.random.Generator) -> Hand:
    """Somebody's hand: bones differ by some 4 %, spread and bends by a few degrees."""
    thumb, bends = GESTURES[gesture]
    size, stout, spread = random.normal(1, [0.035, 0.04, 0.25]).clip([0.92, 0.9, 0.5], [1.08, 1.1, 1.5])
    fingers = [_thumb(thumb, float(stout))]
    for (base, aside, bones, radii), bend in zip(FINGERS, bends, strict=True):
        way = turning([0, 0, 1], -aside * spread + random.normal(0, 1.5))
        angles = np.cumsum(np.asarray(bend) + random.normal(0, 2.5, 3) * (bend is not FOLDED))
        points = [np.asarray(base, dtype=float)]
        for length, angle in zip(bones, np.radians(angles), strict=True):
            points.append(points[-1] + size * length * way @ [0, np.cos(angle), np.sin(angle)])
        fingers.append((np.array(points), stout * np.asarray(radii)))
    made = Clay(LOW, HIGH, cell=CELL)
    _palm(made)
    for points, radii in fingers:
        made.limb([(*p, r) for p, r in zip(points, radii, strict=True)], blend=3.5)
        for p, r in zip(points[1:3], radii[1:3], strict=True):  # joints are thicker than bones
            made.ball(p, r + 0.7, blend=3)
    return Hand(*made.mesh(), fingers)


def _thumb(joints: tuple[tuple[float, ...], ...], stout: float) -> tuple[np.ndarray, np.ndarray]:
    return np.array([(21, 20, 6), *joints], dtype=float), stout * np.array([15, 12.0, 10.2, 7.6])


def _palm(made: Clay) -> None:
    for x in (-11, 11):  # forearm and wrist, wider than thick
        made.limb([(1.5 * x, -125, -4, 24), (1.25 * x, -45, -3, 20), (x, 2, -2, 16.5)], blend=14)
    for (x, y, z), _, _, _ in FINGERS:
        made.limb([(0.55 * x, 4, -3, 13), (0.95 * x, 0.6 * y, -1, 11), (x, y, z, 11)], blend=12)
        made.limb([(0.4 * x, 22, -13, 1.6), (0.97 * x, y - 10, -10.5, 2.4)], blend=5)  # tendon
        made.ball((x, y, -4.5), 9.0, blend=5)  # knuckle
    made.ball((24, 44, 7), (16, 32, 13), blend=18, turn=turning([0, 0, 1], -28))  # ball of the thumb
    made.ball((-24, 38, 4), (13, 34, 11), blend=18)
    made.ball((2, 52, 15), (13, 20, 6), blend=12, cut=True)  # hollow of the palm
