"""Bodies of the machine: toothed wheels, pillars, screws, a cock; millimetres, faces towards +z."""

from __future__ import annotations

import numpy as np
from solids import Body, grid, joined, placed, turned, turning
from train import Wheel, outline

BEVEL_MM = 0.22
UPRIGHT = turning([1, 0, 0], 90)  # from bodies turned about y to the axes of wheels, along z


def wheel_body(wheel: Wheel, *, arms: int, thick_mm: float) -> Body:
    """A wheel about the z axis, its face at z = 0, a tooth at angle 0; its texture is seen along z."""
    module = 2 * wheel.radius / wheel.teeth
    root = wheel.radius - 1.32 * module
    rim = outline(wheel)
    angle = np.arctan2(rim[:, 1], rim[:, 0])
    solid = wheel.radius < 9.5
    hub = min(0.34 * wheel.radius, 5.0)
    inner = hub if solid else root - max(1.6, 0.10 * wheel.radius)
    circle = inner * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    profile = [(circle, -thick_mm), (circle, 0.0), (outline(wheel, inset_mm=BEVEL_MM), 0.0), (rim, -BEVEL_MM)]
    parts = [_strip([*profile, (rim, -thick_mm)])]
    if not solid:
        parts += [_arm(2 * np.pi * k / arms, hub, inner, arms, thick_mm) for k in range(arms)]
        parts.append(_ring(0.8, hub, thick_mm))
    parts.append(_boss(hub))
    return _seen_along_z(joined(parts), wheel.radius + 1.2 * module)


def _strip(rings: list[tuple[np.ndarray, float]]) -> Body:
    """Closed curves (n, 2), each at its height, joined one to the next."""
    points = [np.column_stack([curve, np.full(len(curve), z)]) for curve, z in rings]
    made = grid(np.stack(points))
    return made._replace(triangles=made.triangles[:, ::-1])


def _ring(inner: float, outer: float, thick_mm: float) -> Body:
    a = np.linspace(0, 2 * np.pi, 73)
    unit = np.stack([np.cos(a), np.sin(a)], axis=1)
    low, top = -thick_mm, 0.0
    rings = [(inner * unit, low), (inner * unit, top), ((outer - BEVEL_MM) * unit, top)]
    return _strip([*rings, (outer * unit, -BEVEL_MM), (outer * unit, low)])


def _arm(turn: float, hub: float, inner: float, arms: int, thick_mm: float) -> Body:
    """A crossing: wide at the hub, narrow in the middle, with a bevel on both sides."""
    along = np.linspace(hub - 0.8, inner + 0.8, 24)
    share = np.linspace(-1, 1, 24)
    half = (0.75 + 0.28 * inner / arms * 0.5) * (0.55 + 0.45 * share**2)
    sides = [(-half, -thick_mm), (-half, -BEVEL_MM), (BEVEL_MM - half, 0.0), (half - BEVEL_MM, 0.0), (half, -BEVEL_MM)]
    rows = [np.stack([along, side, np.full(24, z)], axis=1) for side, z in [*sides, (half, -thick_mm)]]
    return placed(grid(np.stack(rows)), turn=turning([0, 0, 1], np.degrees(turn)))


def _boss(hub: float) -> Body:
    """The collet and the arbor's end, turned and domed, 1.2 mm before the face."""
    r = 0.72 * hub
    knots = [(r, 0.0), (r, 0.7), (r - 0.3, 1.0), (0.55 * r, 1.0), (0.5 * r, 0.6), (0.4 * r, 0.6)]
    made = turned([*knots, (0.4 * r, 1.15), (0.3 * r, 1.3), (0.0, 1.35)], around=64)
    return placed(made, turn=UPRIGHT)


def _seen_along_z(body: Body, half: float) -> Body:
    return body._replace(uv=body.vertices[:, :2] / (2 * half) + 0.5)


def screw(at: np.ndarray, radius: float, turn_deg: float) -> Body:
    """A screw's head with a slot, as two halves of a disc with a gap, its face at z = 0."""
    a = np.linspace(0, np.pi, 25)
    slot = 0.14 * radius
    halves = []
    for side in (0.0, 180.0):
        curve = np.stack([radius * np.cos(a), np.maximum(radius * np.sin(a), slot)], axis=1)
        flat = np.stack([curve[:, 0], np.full(25, slot)], axis=1)
        points = [
            (flat, -0.5),
            (flat, 0.0),
            (0.93 * curve + [0, 0.05 * slot], 0.0),
            (curve, -0.1 * radius),
            (curve, -1.2),
        ]
        made = grid(np.stack([np.column_stack([c, np.full(25, z)]) for c, z in points]))
        halves.append(placed(made._replace(triangles=made.triangles[:, ::-1]), turn=turning([0, 0, 1], side)))
    return placed(joined(halves), [*at, 0.0], turn=turning([0, 0, 1], turn_deg))


def pillar(at: np.ndarray, low: float, high: float) -> Body:
    """A turned pillar between heights, with two rings."""
    h = high - low
    knots = [
        (3.6, 0),
        (3.6, 0.06),
        (2.3, 0.1),
        (1.9, 0.3),
        (2.6, 0.46),
        (2.6, 0.54),
        (1.9, 0.7),
        (2.3, 0.9),
        (3.2, 0.94),
    ]
    made = turned([(r, h * s) for r, s in [*knots, (3.2, 1.0), (0.0, 1.0)]], around=48)
    return placed(made, [*at, low], turn=UPRIGHT)


def cock(start: np.ndarray, stop: np.ndarray, z: float) -> Body:
    """A bridge with round ends over two arbors, its face at z."""
    way = stop - start
    length, turn = float(np.hypot(*way)), float(np.degrees(np.arctan2(way[1], way[0])))
    a = np.linspace(np.pi / 2, 3 * np.pi / 2, 25)
    left = np.stack([3.4 * np.cos(a), 3.4 * np.sin(a)], axis=1)
    waist = np.stack([np.linspace(0.15, 0.85, 12) * length, -2.1 * np.ones(12)], axis=1)
    right = np.stack([length - 3.4 * np.cos(a), -3.4 * np.sin(a)], axis=1)
    curve = np.concatenate([left, waist, right, [[length - x, -y] for x, y in waist], left[:1]])
    middle = np.stack([np.clip(curve[:, 0], 0, length), 0 * curve[:, 1]], axis=1)
    inset = curve + 0.35 * (middle - curve) / np.maximum(np.linalg.norm(middle - curve, axis=1), 1e-9)[:, None]
    rings = [(middle, 0.0), (inset, 0.0), (curve, -0.35), (curve, -2.5)]
    made = _strip(rings)
    seen = made._replace(uv=made.vertices[:, :2] / 24.0 + [0.2, 0.5])
    return placed(seen, [*start, z], turn=turning([0, 0, 1], turn))
