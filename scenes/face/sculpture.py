"""The head: skull, jaw, nose, lids, lips, ears and neck of clay; locks of hair as tubes. Millimetres.

The face looks along +z, y is up, x is the sitter's left; the eyes are at y = 0, the neck's axis near z = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from clay import Clay
from solids import Body, grid, joined, rounded, tube, turning

LOW, HIGH, CELL = (-104, -190, -122), (104, 124, 112), 1.5
EYE_R = 12.3
SKULL, SKULL_R = np.array([0.0, 28.0, -18.0]), np.array([74.0, 84.0, 93.0])


@dataclass(frozen=True)
class Features:
    """What differs from face to face; factors are 1 for the mean face."""

    wide: float
    jaw: float
    nose: float
    bridge: float
    lips: float
    eyes_apart: float
    brow: float
    ear: float

    @property
    def eye(self) -> np.ndarray:
        return np.array([31.5 * self.eyes_apart, 0.0, 60.5])


def drawn(random: np.random.Generator) -> Features:
    """Somebody, as chance has it: one standard deviation is about that of adults (some 5 %)."""
    return Features(*(float(np.clip(random.normal(1, 0.055), 0.88, 1.12)) for _ in range(8)))


def head(features: Features) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and outward triangles (m, 3)."""
    made = Clay(LOW, HIGH, cell=CELL)
    _skull(made, features)
    _nose(made, features)
    _mouth(made, features)
    for side in (-1, 1):
        _eye(made, features, side=side)
        _ear(made, features, side=side)
    return made.mesh()


def _skull(made: Clay, f: Features) -> None:
    w, j = f.wide, f.jaw
    made.ball(SKULL, SKULL_R, blend=1)
    made.ball((0, -26, 18), (60 * w, 74, 58), blend=22)
    made.ball((0, -40, 40), (40 * w, 48, 38), blend=22)
    made.limb([(0, -60, -26, 46), (0, -200, -36, 54)], blend=12)  # neck
    for s in (-1, 1):
        made.limb(
            [(57 * w * s, -40, -6, 11), (41 * w * s, -80 * j, 24, 11), (11 * s, -103 * j, 58, 12)], blend=16
        )
        made.ball((43 * w * s, -24, 46), (19, 15, 20), blend=20)  # cheek bone
        made.limb(
            [(9 * s, 17, 72, 7.5), (27 * s, 21, 70, 8 * f.brow), (49 * w * s, 15, 50, 8)], blend=14
        )  # brow
        made.ball((76 * w * s, 24, 36), (15, 24, 24), blend=14, cut=True)  # temple
        made.limb([(56 * s, -34, -44, 8), (20 * s, -170, 12, 7)], blend=16)  # sternomastoid
    made.ball((0, -98 * j, 62), (16 * j, 13, 13), blend=14)  # chin
    made.ball((0, -84 * j, 84), (16, 6, 9), blend=12, cut=True)  # between chin and lip
    made.limb([(0, -160, 18, 7), (0, -136, 18, 8)], blend=10)  # larynx


def _nose(made: Clay, f: Features) -> None:
    tip = np.array([0, -34 * f.nose, 97 + 6 * (f.bridge - 1)])
    made.limb([(0, 10, 72 + 8 * (f.bridge - 1), 6.5), (0, -14, 84 * f.bridge, 7.5), (*tip, 9.5)], blend=9)
    made.ball(tip, (10.5 * f.wide, 9, 9), blend=6)
    for s in (-1, 1):
        wing = np.array([12.5 * f.wide * s, tip[1] - 3, 84])
        made.ball(wing, (6.5, 7.5, 9), blend=6)
        made.limb([(5.5 * s, tip[1] - 11, 92, 3.0), (6.5 * s, tip[1] - 3, 88, 2.4)], blend=2.5, cut=True)
        fold = [
            (17 * f.wide * s, tip[1] - 1, 81, 0.6),
            (26 * s, tip[1] - 18, 78, 0.7),
            (31 * s, tip[1] - 30, 72, 0.4),
        ]
        made.limb(fold, blend=7, cut=True)  # from nose to mouth
    made.limb([(0, tip[1] - 14, 88, 2.6), (0, -59, 88, 2.8)], blend=5, cut=True)  # philtrum


def _mouth(made: Clay, f: Features) -> None:
    full = f.lips
    made.ball((0, -68, 60), (30, 20, 24), blend=14)
    for s in (-1, 1):
        made.limb(
            [(0, -63.5, 81.5, 4.2 * full), (8 * s, -62.4, 80.5, 4.4 * full), (24 * s, -67.5, 71, 2.0)],
            blend=3.5,
        )
        made.limb(
            [(0, -74.0, 80.5, 5.4 * full), (11 * s, -73.2, 78.5, 4.8 * full), (23 * s, -68.5, 71, 2.0)],
            blend=3.5,
        )
        seam = [
            (0, -68.4, 88.0, 2.1),
            (11 * s, -68.0, 85.0, 2.1),
            (20 * s, -67.8, 77.8, 1.7),
            (27 * s, -69.0, 71, 1.5),
        ]
        made.limb(seam, blend=2.2, cut=True)
    made.ball((0, -82, 84), (17, 3.5, 4), blend=6, cut=True)


def _eye(made: Clay, f: Features, *, side: int) -> None:
    x, y, z = f.eye * (side, 1, 1)
    made.ball((x, y + 1, z + 16), (18, 12, 14), blend=13, cut=True)  # socket
    made.ball((x, y, z), EYE_R + 2.2, blend=7)  # lids, closed
    tilt = turning([0, 0, 1], 4 * side)
    made.ball(
        (x + 0.3 * side, y - 0.4, z + 12), (13.8, 5.3, 12), blend=1.6, turn=tilt, cut=True
    )  # their opening
    lid = [(x - 13 * side, y - 1.5, z + 10.5, 1.6), (x - 5 * side, y + 6.0, z + 13.0, 1.7)]
    lid += [(x + 5 * side, y + 6.3, z + 12.6, 1.7), (x + 14 * side, y + 0.6, z + 8.0, 1.6)]
    made.limb(lid, blend=2.4)
    crease = [
        (x - 12 * side, y + 4, z + 14, 1.2),
        (x, y + 10.5, z + 14.5, 1.2),
        (x + 14 * side, y + 5, z + 9, 1.2),
    ]
    made.limb(crease, blend=4, cut=True)
    made.ball((x - 13.5 * side, y - 1.2, z + 9.5), (2.6, 2.0, 2.4), blend=1.5)  # inner corner


def _ear(made: Clay, f: Features, *, side: int) -> None:
    e, x = f.ear, 70 * side
    lean = turning([1, 0, 0], -10) @ turning([0, 1, 0], -26 * side)
    made.ball((x + 5 * side, -8, -16), np.array([5, 29 * e, 17]), blend=6, turn=lean)
    made.ball((x + 12 * side, -5, -12), np.array([7, 19 * e, 10]), blend=4, turn=lean, cut=True)
    rim = np.array(
        [(3, -22, -2), (4, 2, 0), (8, 19, -5), (12, 24, -17), (13, 14, -29), (10, -6, -30), (5, -24, -20)]
    )
    path = rounded(rim * [1, e, 1], steps=4)
    made.limb([(x + p[0] * side, p[1] - 8, p[2], 2.9) for p in path], blend=2.5)
    made.limb([(x + 3 * side, -14, -2, 3.6), (x + 3 * side, -6, -3, 3.0)], blend=3)  # tragus
    made.ball((x + 3 * side, -33 * e, -10), (4, 7, 6), blend=4)  # lobe


def hair(style: str, random: np.random.Generator) -> Body:
    """Locks that lie on the skull from the parting, or from the hairline towards a bun; under them a cap."""
    if style == "cropped":
        return joined(_cropped(random))
    locks = [_cap(), *(_lock(style, random) for _ in range(430))]
    if style == "bun":
        locks += _bun(random)
    return joined(locks)


def _on_skull(azimuth: Any, polar: Any, lift: Any) -> np.ndarray:
    """Points over the skull: azimuth from +z towards +x, polar from the crown, both rad; lift in mm."""
    level = np.sin(polar)
    unit = np.stack([level * np.sin(azimuth), np.cos(polar), level * np.cos(azimuth)], axis=-1)
    return SKULL + unit * (SKULL_R + np.asarray(lift)[..., None])


def _hairline(azimuth: Any) -> np.ndarray:
    """Polar angle (rad) at which hair begins, by azimuth: high over the forehead, low behind the ears."""
    turn = np.degrees(np.abs(azimuth))
    return np.radians(
        np.interp(turn, [0, 28, 48, 62, 80, 100, 125, 180], [50, 53, 66, 88, 102, 99, 126, 132])
    )


def _cap() -> Body:
    """What is seen between the locks: hair close to the skull, up to the hairline."""
    azimuth = np.linspace(-np.pi, np.pi, 91)
    polar = np.linspace(0.0, 0.985, 30)[:, None] * _hairline(azimuth)
    points = _on_skull(azimuth, polar, np.full(polar.shape, 1.2))
    uv = np.stack(np.broadcast_arrays(azimuth * 8 / np.pi, polar / 2), axis=2)
    return grid(points[::-1], uv=uv[::-1])


def _lock(style: str, random: np.random.Generator) -> Body:
    azimuth = random.uniform(-np.pi, np.pi)
    edge = float(_hairline(azimuth)) * random.uniform(0.9, 1.0)
    steps = np.linspace(0, 1, 12)
    thick = random.uniform(2.6, 4.4)
    if style == "bun":  # combed back to a knot behind the crown
        start = edge * np.sqrt(random.uniform(0.02, 1.0))
        goal = np.array([np.sin(0.9) * np.sin(np.pi), np.cos(0.9), np.sin(0.9) * np.cos(np.pi)])
        first = np.array([np.sin(start) * np.sin(azimuth), np.cos(start), np.sin(start) * np.cos(azimuth)])
        way = first + (goal - first) * steps[:, None]
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        lift = random.uniform(0.5, 4.0) + 2.0 * np.sin(np.pi * steps) * random.uniform(0.3, 1)
        path = SKULL + way * (SKULL_R + lift[:, None])
    else:  # falls to both sides of a parting
        left = 1 if azimuth > np.radians(12) or azimuth < -np.pi + 0.3 else -1
        start = np.clip(random.normal(0.1, 0.12), 0.02, 0.5)
        root = np.radians(14) + random.uniform(-0.05, 0.05)
        bend = azimuth - root
        polar = start + (edge * random.uniform(0.92, 1.04) - start) * steps
        wave = 0.06 * left * np.sin(3 * steps + random.uniform(0, 6))
        sweep = root + bend * np.clip(steps * 2.2, 0, 1) ** 0.8 + wave
        lift = 1.5 + random.uniform(0, 5) + 4.0 * np.sin(np.pi * steps * 0.9) - 4.0 * steps**4
        path = _on_skull(sweep, polar, lift)
    radius = thick * np.interp(steps, [0, 0.15, 0.7, 1.0], [0.5, 1, 1, 0.35])
    return tube(path, radius, around=7, flat=0.7)


def _bun(random: np.random.Generator) -> list[Body]:
    centre = _on_skull(np.array(np.pi), np.array(0.9), np.array(20.0))
    made = []
    for _ in range(60):
        frame = np.linalg.qr(random.normal(0, 1, (3, 3)))[0]
        angle = np.linspace(0, np.pi * random.uniform(0.7, 1.4), 14)[:, None]
        path = centre + 24 * (np.cos(angle) * frame[0] + np.sin(angle) * frame[1])
        made.append(tube(path, 3.4, around=7, flat=0.7))
    return made


def _cropped(random: np.random.Generator) -> list[Body]:
    """Short tufts that follow the skull away from the crown, a little on end."""
    made = [_cap()]
    for _ in range(1500):
        azimuth = random.uniform(-np.pi, np.pi)
        edge = float(_hairline(azimuth))
        polar = np.arccos(1 - random.uniform(0, 1) * (1 - np.cos(edge)))
        steps = np.linspace(0, 1, 5)
        length = random.uniform(0.10, 0.19)
        lift = 1.0 + 2.6 * np.sin(np.pi * (0.15 + 0.6 * steps)) * random.uniform(0.6, 1.5)
        path = _on_skull(azimuth + 0.12 * steps * random.normal(0, 1), polar + length * (steps - 0.5), lift)
        radius = random.uniform(1.8, 3.0) * np.array([0.6, 1, 1, 0.8, 0.3])
        made.append(tube(path, radius, around=6, flat=0.7))
    return made
