"""How a branch grows: a winding axis, side shoots in turn about it, leaves on stalks, flowers in clusters."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from meshes import Body, tube

GOLDEN = np.radians(137.5)
DOWN = np.array([0.0, -1.0, 0.0])
STEP_M = 0.008


@dataclass
class Branch:
    """Wood, and where leaves and flowers sit: places (m), frames (rows: side, along, face), sizes (m)."""

    foot: np.ndarray
    wood: list[Body] = field(default_factory=list)
    leaves: list[tuple[np.ndarray, np.ndarray, float]] = field(default_factory=list)
    flowers: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)

    def leaf_arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places (n, 3), frames (n, 3, 3), sizes (n,)."""
        place, frame, size = zip(*self.leaves, strict=True)
        return np.array(place), np.array(frame), np.array(size)


def grow(
    foot: np.ndarray,
    heading: np.ndarray,
    length: float,
    random: np.random.Generator,
    *,
    leaf_m: float = 0.050,
    flat: float = 1.0,
    flowers: int = 0,
    thick_m: float = 0.0045,
    spur_m: float = 0.042,
) -> Branch:
    """A branch from its foot; ``flat`` below 1 keeps shoots and leaves near the plane of the picture (z).

    ``spur_m``: from one shoot to the next.
    """
    made = Branch(np.asarray(foot, dtype=np.float64))
    axis = _winding(made.foot, heading, length, random, sag=0.35)
    axis[:, 2] = made.foot[2] + flat * (axis[:, 2] - made.foot[2])
    radius = np.linspace(thick_m, 0.35 * thick_m, len(axis))
    made.wood.append(tube(axis, radius, around=10, tone=0.13))
    squeeze = np.array([1.0, 1.0, flat])
    turn = random.uniform(0, 2 * np.pi)
    spur_every = int(spur_m / STEP_M)
    for k in range(2 * spur_every, len(axis) - 2, spur_every):
        turn += GOLDEN
        along = _unit(axis[min(k + 1, len(axis) - 1)] - axis[k - 1])
        out = _unit(_about(along, turn) * squeeze)
        way = _unit(0.75 * along + out - 0.15 * DOWN)
        shoot = _winding(axis[k], way, random.uniform(0.035, 0.13) * (1.15 - 0.6 * k / len(axis)), random, sag=0.2)
        shoot[:, 2] = axis[k, 2] + flat * (shoot[:, 2] - axis[k, 2])
        made.wood.append(tube(shoot, np.linspace(0.0022, 0.0011, len(shoot)), around=6, tone=0.16))
        _leafy(made, shoot, random, leaf_m=leaf_m, squeeze=squeeze)
    _leafy(made, axis[-int(0.09 / STEP_M) :], random, leaf_m=leaf_m, squeeze=squeeze)
    for _ in range(flowers):
        at = axis[int(random.uniform(0.35, 0.95) * (len(axis) - 1))]
        out = _unit(random.normal(0, 1, 3) * [1, 1, 0.5] + [0, 0.25, 0.9])
        tip = at + 0.032 * _unit(out * squeeze + [0, 0.2, 0])
        stalk = np.linspace(at, tip, 4) + np.linspace(0, 0.003, 4)[:, None] * DOWN
        made.wood.append(tube(stalk, np.full(4, 0.0009), around=5, tone=0.22))
        made.flowers.append((tip, out))
    return made


def _winding(
    foot: np.ndarray, heading: np.ndarray, length: float, random: np.random.Generator, *, sag: float
) -> np.ndarray:
    count = max(int(length / STEP_M), 4)
    way = _unit(np.asarray(heading, dtype=np.float64))
    wander = random.normal(0, 1, 3)
    points = [np.asarray(foot, dtype=np.float64)]
    for _ in range(count):
        wander = 0.85 * wander + 0.5 * random.normal(0, 1, 3)
        way = _unit(way + 0.022 * wander + sag * STEP_M * DOWN)
        points.append(points[-1] + STEP_M * way)
    return np.array(points)


def _leafy(made: Branch, shoot: np.ndarray, random: np.random.Generator, *, leaf_m: float, squeeze: np.ndarray) -> None:
    """Leaves in turn about a shoot, smaller to its tip, hanging a little, faces to the light."""
    turn = random.uniform(0, 2 * np.pi)
    for k in range(1, len(shoot), 2):
        turn += GOLDEN
        along = _unit(shoot[k] - shoot[k - 1])
        share = k / len(shoot)
        out = _about(along, turn)
        way = _unit((out + (0.35 + 0.9 * share) * along) * squeeze + 0.45 * DOWN)
        base = shoot[k] + random.uniform(0.010, 0.020) * _unit((out + 0.8 * along) * squeeze)
        made.wood.append(tube(np.linspace(shoot[k], base, 3), np.full(3, 0.0007), around=5, tone=0.20))
        light = random.normal(0, 0.45, 3) + np.array([0.0, 0.75, 0.55])
        face = _unit(light - way * float(light @ way))
        size = leaf_m * random.uniform(0.7, 1.2) * (1.05 - 0.45 * share)
        made.leaves.append((base, np.stack([np.cross(way, face), way, face]), size))


def _about(along: np.ndarray, turn: float) -> np.ndarray:
    """The direction across ``along``, turned about it."""
    side = _unit(np.cross(along, [0.0, 0.0, 1.0] if abs(along[2]) < 0.9 else [1.0, 0.0, 0.0]))
    return np.cos(turn) * side + np.sin(turn) * np.cross(side, along)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)
