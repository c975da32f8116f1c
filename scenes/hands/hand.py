"""Somebody's hand from the shapes in ``hand.npz``, its fingers bent as a gesture has them. Millimetres.

A right hand that shows its palm: the wrist is the origin, y leads along the hand, x to the thumb, z out of
the palm.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize
from solids import turning
from subdivision import subdivided

MM = 0.01  # a count of the file
LEVELS = 2
WRIST, ELBOW = 20, 23  # among the joints, whose first 20 are those of five fingers, thumb first
FLAT, FOLDED = (6.0, 8.0, 5.0), (72.0, 92.0, 52.0)  # bends of the three joints, deg
GESTURES: dict[str, tuple[str, tuple[tuple[float, float, float], ...]]] = {
    "open": ("", (FLAT, FLAT, FLAT, FLAT)),
    "point": ("middle", (FLAT, FOLDED, FOLDED, FOLDED)),
    "two": ("ring", (FLAT, FLAT, FOLDED, FOLDED)),
    "ring": ("index", ((42, 48, 26), (16, 16, 10), (10, 12, 8), FLAT)),
    "cupped": ("", ((24, 28, 16), (26, 30, 18), (28, 30, 18), (30, 32, 20))),
}
FINGER = {"index": 1, "middle": 2, "ring": 3}


@dataclass(frozen=True)
class Hand:
    """Split along the seams of its picture: where its vertices are, and where at rest."""

    vertices: np.ndarray  # (n, 3)
    normals: np.ndarray  # (n, 3)
    quads: np.ndarray  # (m, 4)
    uv: np.ndarray  # (n, 2) in 0..1
    rest: np.ndarray  # (n, 3)
    rest_normals: np.ndarray  # (n, 3)
    nails: np.ndarray  # (n,) in 0..1
    joints: np.ndarray  # (5, 4, 3), at rest

    @property
    def triangles(self) -> np.ndarray:
        return np.concatenate([self.quads[:, [0, 1, 2]], self.quads[:, [0, 2, 3]]])


def hand(gesture: str, params: dict[str, Any], random: np.random.Generator) -> Hand:
    """The hand of this sex and age; its build, spread and bends differ by chance."""
    file = np.load(Path(__file__).with_name("hand.npz"))
    old = float(np.clip((float(params["age_years"]) - 25) / 65, 0, 1))
    first = 2 if params["sex"] == "male" else 0
    points = file["base"] + (1 - old) * file["macro"][first].astype(float) + old * file["macro"][first + 1]
    for k in range(0, len(file["detail"]), 2):
        points += random.uniform(0, 0.6) * file["detail"][k + int(random.integers(2))]
    body = len(file["weights"])
    points, joints = points[:body] * MM, points[body:] * MM
    mesh = subdivided(file["quads"], body, levels=LEVELS)
    corners = file["uv"][file["uv_quads"]] / 65535.0
    for _ in range(LEVELS):  # straight halves: each quad's corners, sides, middle, in the order of the quads
        after, before = (corners + np.roll(corners, shift, axis=1) for shift in (-1, 1))
        middle = np.broadcast_to(corners.mean(axis=1, keepdims=True), corners.shape)
        corners = np.stack([corners, after / 2, middle, before / 2], axis=2).reshape(-1, 4, 2)
    keys = np.column_stack([mesh.quads.ravel(), np.round(corners.reshape(-1, 2) * 2**20).astype(np.int64)])
    unique, first_at, split = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    quads = split.reshape(-1, 4)
    whole = unique[:, 0]
    bent = mesh.weights @ _posed(points, joints, file["weights"], gesture, random)
    rest = mesh.weights @ points
    return Hand(
        bent[whole], normals(bent, mesh.triangles)[whole], quads,
        corners.reshape(-1, 2)[first_at], rest[whole], normals(rest, mesh.triangles)[whole],
        (mesh.weights @ (file["nails"] / 255))[whole], joints[:20].reshape(5, 4, 3),
    )  # fmt: skip


def normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Of vertices, from the areas of the triangles around them."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    total = np.stack(
        [np.bincount(triangles.ravel(), np.repeat(across[:, k], 3), len(vertices)) for k in range(3)], axis=1
    )
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)


class _Pose:
    """A turn and a shift, which come one after the other."""

    def __init__(self, turn: np.ndarray, shift: np.ndarray) -> None:
        self.turn, self.shift = turn, shift

    def then_about(self, pivot: np.ndarray, turn: np.ndarray) -> _Pose:
        """This pose after a turn about a point at rest."""
        return _Pose(self.turn @ turn, self.shift + self.turn @ (pivot - turn @ pivot))

    def __call__(self, points: np.ndarray) -> np.ndarray:
        return points @ self.turn.T + self.shift


AT_REST = _Pose(np.eye(3), np.zeros(3))


def _posed(
    points: np.ndarray, joints: np.ndarray, weights: np.ndarray, gesture: str, random: np.random.Generator
) -> np.ndarray:
    thumb, bends = GESTURES[gesture]
    fingers = joints[:20].reshape(5, 4, 3)
    spread = float(random.uniform(0.0, 1.0))
    chains = [[]]
    for k, bend in enumerate(bends):
        wanted = np.asarray(bend) + random.normal(0, 2.5, 3)
        aside = (1.5 - k) * (3.0 * spread if gesture in ("open", "two", "point") else 0.5) + random.normal(0, 0.8)
        chains.append(_finger(fingers[k + 1], wanted, -aside if bend is not FOLDED else 0.0))
    chains[0] = _thumb(fingers, chains, thumb, random)
    poses = [AT_REST] * 6 + [pose for chain in chains for pose in chain]
    share = weights / weights.sum(axis=1, keepdims=True, dtype=float)
    return sum(share[:, k : k + 1] * pose(points) for k, pose in enumerate(poses))


def _finger(joints: np.ndarray, wanted: np.ndarray, aside_deg: float) -> list[_Pose]:
    """Of the three bones: bent by the wanted angles (deg) against the palm, spread aside at the knuckle."""
    ways = np.diff(joints, axis=0)
    level = ways[0] * [1, 1, 0]
    level /= np.linalg.norm(level)
    axis = np.cross(level, [0, 0, 1])
    angles = np.degrees(np.arctan2(ways[:, 2], ways @ level))
    more = wanted - np.diff(np.concatenate([[0], angles]))
    pose, made = AT_REST, []
    for k in range(3):
        turn = turning(axis, more[k]) if k else turning([0, 0, 1], aside_deg) @ turning(axis, more[0])
        pose = pose.then_about(joints[k], turn)
        made.append(pose)
    return made


def _thumb(fingers: np.ndarray, chains: list[list[_Pose]], goal: str, random: np.random.Generator) -> list[_Pose]:
    """Of the three bones of the thumb: as it lies at rest, or with its pad on a finger."""
    joints = fingers[0]
    ways = np.diff(joints, axis=0)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    axis = np.cross(ways[1], [-0.96, 0.24, 0.16])
    axis /= np.linalg.norm(axis)  # about which its outer joints bend

    def bent(angles: np.ndarray) -> list[_Pose]:
        root = turning([0, 1, 0], -angles[0]) @ turning([0, 0, 1], angles[1]) @ turning(ways[0], angles[2])
        made = [AT_REST.then_about(joints[0], root)]
        for k in (1, 2):
            made.append(made[-1].then_about(joints[k], turning(axis, angles[k + 2])))
        return made

    if not goal:
        return bent(random.normal(0, 1, 5) * [4, 4, 3, 4, 5])
    k = FINGER[goal]
    inward = np.cross(axis, ways[2])
    pad = joints[3] - 5 * ways[2] + 7 * inward
    if goal == "index":
        there = chains[k][2](fingers[k][3] - 4 * np.array([0, 1, 0]) + [0, 0, 8.0])
    else:
        middle = fingers[k][1:3].mean(axis=0)
        there = chains[k][1](middle + np.array([0, 0, -10.5]))

    def off(angles: np.ndarray) -> float:
        hard = np.clip(angles - [60, 35, 35, 55, 70], 0, None) + np.clip([-10, -25, -35, -10, -15] - angles, 0, None)
        return float(((bent(angles)[2](pad) - there) ** 2).sum() + 0.012 * (angles**2).sum() + 2 * (hard**2).sum())

    best = minimize(off, np.array([25.0, 10.0, 5.0, 15.0, 20.0]), method="Powell", options={"maxiter": 40})
    return bent(best.x)
