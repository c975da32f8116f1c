"""Catmull-Clark subdivision of meshes of quads, as a matrix that carries any value of the vertices along.

The rules are those of Catmull and Clark ("Recursively generated B-spline surfaces on arbitrary topological meshes",
Computer-Aided Design 10, 1978, doi:10.1016/0010-4485(78)90110-0); open rims become cubic B-splines.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse


class Subdivided(NamedTuple):
    """A finer mesh: its ``quads`` (m, 4), and ``weights`` (fine, coarse), by which values of the vertices follow."""

    quads: np.ndarray
    weights: sparse.csr_matrix

    @property
    def triangles(self) -> np.ndarray:
        """Two triangles (2 m, 3) for each quad, with the same front."""
        return np.concatenate([self.quads[:, [0, 1, 2]], self.quads[:, [0, 2, 3]]])


def subdivided(quads: np.ndarray, count: int, *, levels: int) -> Subdivided:
    """Divide each of the quads (m, 4) of ``count`` vertices into four, ``levels`` times."""
    made = Subdivided(np.asarray(quads, dtype=np.int64), sparse.identity(count, format="csr"))
    for _ in range(levels):
        finer = _once(made.quads, made.weights.shape[0])
        made = Subdivided(finer.quads, sparse.csr_matrix(finer.weights @ made.weights))
    return made


def _once(quads: np.ndarray, count: int) -> Subdivided:
    faces = len(quads)
    ends = np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, of_corner, used = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True, return_counts=True)
    of_corner = of_corner.reshape(faces, 4)
    to_face = _matrix(np.repeat(np.arange(faces), 4), quads.ravel(), 0.25, (faces, count))
    middle = _matrix(np.repeat(np.arange(len(edges)), 2), edges.ravel(), 0.5, (len(edges), count))
    beside = _matrix(of_corner.ravel(), np.repeat(np.arange(faces), 4), 1.0, (len(edges), faces))
    open_edge = used < 2
    inner = sparse.diags(np.where(open_edge, 0.0, 0.5))
    points = (sparse.identity(len(edges)) - inner) @ middle + (inner / 2) @ (beside @ to_face)
    degree = np.bincount(edges.ravel(), minlength=count).astype(float)
    touching = np.bincount(quads.ravel(), minlength=count).astype(float)
    on_rim = np.zeros(count, dtype=bool)
    on_rim[edges[open_edge].ravel()] = True
    n = np.maximum(degree, 1)
    at_face = _matrix(quads.ravel(), np.repeat(np.arange(faces), 4), 1.0, (count, faces))
    at_edge = _matrix(edges.ravel(), np.repeat(np.arange(len(edges)), 2), 1.0, (count, len(edges)))
    free = np.where(on_rim | (touching == 0), 0.0, 1.0)
    smooth = (
        sparse.diags(free / (n * np.maximum(touching, 1))) @ (at_face @ to_face)
        + sparse.diags(2 * free / n**2) @ (at_edge @ middle)
        + sparse.diags(free * (n - 3) / n)
    )
    rims = edges[open_edge]
    along = _matrix(rims.ravel(), rims[:, ::-1].ravel(), 0.125, (count, count))
    kept = smooth + along + sparse.diags(np.where(on_rim, 0.75, np.where(touching == 0, 1.0, 0.0)))
    corners = np.arange(faces)[:, None] + np.zeros(4, dtype=np.int64)
    first_edge, first_face = count, count + len(edges)
    finer = np.stack(
        [quads, first_edge + of_corner, first_face + corners, first_edge + np.roll(of_corner, 1, axis=1)], axis=2
    )
    return Subdivided(finer.reshape(-1, 4), sparse.csr_matrix(sparse.vstack([kept, points, to_face])))


def _matrix(rows: np.ndarray, columns: np.ndarray, value: float, shape: tuple[int, int]) -> sparse.csr_matrix:
    return sparse.csr_matrix((np.full(rows.size, value), (rows, columns)), shape=shape)
