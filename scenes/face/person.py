"""Somebody's head and shoulders, mixed from the shapes in ``head.npz``. Millimetres.

The origin lies between the eyes; the face looks along +z, y is up, x is the sitter's left.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import KDTree
from subdivision import Subdivided, subdivided

MM = 0.01  # a count of the file
LEVELS = 2
MASKS = ("lips", "ears", "lids", "mouth")
SKULL = np.array([0.0, 8.0, -75.0])  # middle of the head
ANCESTRY = ("african", "asian", "caucasian")  # names of the shapes, as their makers gave them
ASYMMETRY = 0.5


@dataclass(frozen=True)
class Person:
    """The skin at two finenesses, the masks of its vertices in 0..1, and where eyes and lashes are."""

    coarse: np.ndarray  # (n, 3)
    mesh: Subdivided
    vertices: np.ndarray  # (m, 3), of the finer mesh
    normals: np.ndarray  # (m, 3)
    masks: dict[str, np.ndarray]  # (m,)
    eyes: np.ndarray  # (2, 3), left first
    eye_r: float
    lashes: list[tuple[np.ndarray, np.ndarray]]  # roots and tips (k, 3) of the four rows: lower, upper; left, right
    male: bool
    age: float


def drawn(params: dict[str, Any], random: np.random.Generator) -> Person:
    """The person of these parameters: sex and age as given, ancestry, features and mien by chance."""
    file = np.load(Path(__file__).with_name("head.npz"))
    male, age = params["sex"] == "male", float(params["age_years"])
    points = file["base"].astype(np.float64)
    old = float(np.clip((age - 25) / 65, 0, 1))
    shares = random.dirichlet([0.6, 0.6, 0.6])
    names = [str(name) for name in file["macro_names"]]
    for share, ancestry in zip(shares, ANCESTRY, strict=True):
        for weight, years in ((1 - old, "young"), (old, "old")):
            which = names.index(f"{ancestry}-{'male' if male else 'female'}-{years}")
            points += share * weight * file["macro"][which]
    weights = _features([str(name) for name in file["detail_names"]], random)
    start = file["detail_start"]
    for k, weight in enumerate(weights):
        of = slice(int(start[k]), int(start[k + 1]))
        points[file["detail_vertex"][of]] += weight * file["detail_move"][of]
    points *= MM
    body = int(file["body"])
    mesh = subdivided(file["quads"], body, levels=LEVELS)
    vertices = mesh.weights @ points[:body]
    masks = {name: mesh.weights @ (mask[:body] / 255) for name, mask in zip(MASKS, file["masks"], strict=True)}
    balls = points[file["eyes"]]
    low, high = balls.min(axis=1), balls.max(axis=1)
    rows, roots, tips = file["lashes"].T
    lashes = []
    for row in range(4):
        order = np.nonzero(rows == row)[0]
        order = order[np.argsort(points[roots[order], 0])]
        lashes.append((points[roots[order]], points[tips[order]]))
    return Person(
        points[:body], mesh, vertices, normals(vertices, mesh.triangles), masks, (low + high) / 2,
        float((high - low).mean() / 2), lashes, male, age,
    )  # fmt: skip


def normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Of vertices, from the areas of the triangles around them."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    total = np.stack(
        [np.bincount(triangles.ravel(), np.repeat(across[:, k], 3), len(vertices)) for k in range(3)], axis=1
    )
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)


def _features(names: list[str], random: np.random.Generator) -> np.ndarray:
    """How much of each shape of detail: of opposite ones only one, small lopsidedness, hardly a mien."""
    weights = np.zeros(len(names))
    for k, name in enumerate(names):
        if name.startswith("asym"):
            weights[k] = ASYMMETRY * random.uniform(0, 1)
        elif "/" in name:
            usual = 0.18 if name.startswith("head/") else 0.35  # several shapes of the whole head add up
            weights[k] = np.clip(random.normal(0, usual), 0, 0.8)
    for k, name in enumerate(names):
        for one, other in (("-incr", "-decr"), ("-up", "-down")):
            if name.endswith(one) and name.replace(one, other) in names:
                twin = names.index(name.replace(one, other))
                weights[k], weights[twin] = (weights[k], 0) if random.uniform() < 0.5 else (0, weights[twin])
    smile, brows, squint = random.uniform(0, 0.45), random.uniform(0, 0.3), random.uniform(0, 0.35)
    mien = {"mouthSmileLeft": smile, "mouthSmileRight": smile * random.uniform(0.75, 1), "browInnerUp": brows}
    mien |= dict.fromkeys(("eyeSquintLeft", "eyeSquintRight"), squint * 0.4)
    mien |= dict.fromkeys(("cheekSquintLeft", "cheekSquintRight"), smile * 0.5)
    mien |= dict.fromkeys(("eyeBlinkLeft", "eyeBlinkRight"), random.uniform(0.02, 0.13))
    mien |= dict.fromkeys(("mouthPressLeft", "mouthPressRight"), 0.15)
    for name, weight in mien.items():
        weights[names.index(name)] = weight
    return weights


def nearest_on(person: Person, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals (n, 3) of the skin in front of places (x, y) (n, 2), seen along z."""
    front = np.nonzero(person.normals[:, 2] > 0.1)[0]
    off, near = KDTree(person.vertices[front, :2]).query(places, 10)
    near = front[near]
    z = person.vertices[near, 2]
    weight = (z > z.max(axis=1, keepdims=True) - 6) / (off + 0.3) ** 2
    weight /= weight.sum(axis=1, keepdims=True)
    ways = np.einsum("nk,nkd->nd", weight, person.normals[near])
    points = np.column_stack([places, (weight * z).sum(axis=1)])
    return points, ways / np.linalg.norm(ways, axis=1, keepdims=True)
