"""Drops on the outside of an upright wall, and bubbles that cling to its inside; millimetres, y up."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from solids import Body, ball, joined, placed, turned

FACING = 0.75  # radians to both sides of the front in which drops lie
RISE = 0.52  # height of a drop over the radius of its foot: water meets glass at 55 degrees
GROWN_MM, LARGEST_MM = 0.75, 1.9


def drops(
    count: int, radius: float, level: float, ink: Callable[[float, float, float], bool], random: np.random.Generator
) -> Body:
    """Caps with a flat back, a little longer than wide; none touches another, none lies on ink."""
    made, places = [], []
    for size in -np.sort(-np.clip(random.lognormal(np.log(GROWN_MM), 0.42, count), 0.35, LARGEST_MM)):
        for _ in range(12):
            along, high = radius * random.uniform(-FACING, FACING), random.uniform(11, level - 4)
            clear_of = [np.hypot(along - a, (high - h) / 1.1) > 1.12 * (size + s) for a, h, s in places]
            if all(clear_of) and not ink(along, high, 1.2 * size):
                places.append((along, high, size))
                made.append(_drop(size, along / radius, high, radius))
                break
    return joined(made)


def _drop(size: float, angle: float, high: float, radius: float) -> Body:
    """A spherical cap whose foot stands on the wall, at this angle from the front."""
    sphere = size * (1 + RISE**2) / (2 * RISE)
    half = np.arcsin(size / sphere)
    turn = np.linspace(half, 0, 8)
    cap = np.stack([sphere * np.sin(turn), sphere * (np.cos(turn) - np.cos(half))], axis=1)
    both = joined([turned([(0, 0), (size, 0)], around=20), turned(cap, around=20)])
    out = np.array([np.sin(angle), 0, np.cos(angle)])
    frame = np.stack([np.array([np.cos(angle), 0, -np.sin(angle)]), out, np.array([0, -1.0, 0])], axis=1)
    return placed(both, radius * out + [0, high, 0], turn=frame, scale=(1, 1, 1.1))


def bubbles(count: int, radius: float, span: tuple[float, float], random: np.random.Generator) -> Body:
    """Balls of gas just inside the wall of this radius, between two heights; none touches another."""
    made, places = [], []
    while len(made) < count:
        size = float(np.clip(random.lognormal(np.log(0.5), 0.35), 0.25, 1.1))
        angle, high = random.uniform(-1.3, 1.3), random.uniform(span[0] + 3, span[1] - 2)
        middle = np.array([np.sin(angle), 0, np.cos(angle)]) * (radius - size - 0.15) + [0, high, 0]
        if all(np.linalg.norm(middle - p) > size + s + 0.1 for p, s in places):
            places.append((middle, size))
            made.append(ball(middle, size, rings=12, around=20))
    return joined(made)
