"""Sculpture: balls and limbs that melt into each other and cut into each other, meshed where their field is zero."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

FAR = 1e3  # of the empty field, in cells
Vector = Sequence[float]


class Clay:
    """A signed distance field, negative inside, on a grid of cubic cells; all lengths in one unit."""

    def __init__(self, low: Vector, high: Vector, *, cell: float) -> None:
        self.cell = cell
        self.axes = [np.arange(a, b + cell, cell, dtype=np.float32) for a, b in zip(low, high, strict=True)]
        self.field = np.full([axis.size for axis in self.axes], FAR * cell, dtype=np.float32)

    def ball(
        self, centre: Vector, radii: float | Vector, *, blend: float, turn: np.ndarray | None = None, cut: bool = False
    ) -> None:
        """Add (or cut away) an ellipsoid, turned by a matrix (3, 3); its seam is rounded over ``blend``."""
        size = np.broadcast_to(np.asarray(radii, dtype=np.float32), 3)
        reach = float(size.max()) + blend + 2 * self.cell
        near, (x, y, z) = self._near(np.asarray(centre) - reach, np.asarray(centre) + reach, origin=centre)
        if turn is not None:
            inverse = np.asarray(turn, dtype=np.float32).T
            x, y, z = (row[0] * x + row[1] * y + row[2] * z for row in inverse)
        first = np.sqrt((x / size[0]) ** 2 + (y / size[1]) ** 2 + (z / size[2]) ** 2)
        second = np.sqrt((x / size[0] ** 2) ** 2 + (y / size[1] ** 2) ** 2 + (z / size[2] ** 2) ** 2)
        self._merge(near, first * (first - 1) / np.maximum(second, 1e-6), blend=blend, cut=cut)

    def limb(self, knots: Sequence[Vector], *, blend: float, cut: bool = False) -> None:
        """Add (or cut away) a chain of tapering limbs through knots (x, y, z, radius)."""
        for (*start, r0), (*stop, r1) in pairwise(knots):
            a, b = np.asarray(start, dtype=np.float32), np.asarray(stop, dtype=np.float32)
            reach = max(r0, r1) + blend + 2 * self.cell
            near, (x, y, z) = self._near(np.minimum(a, b) - reach, np.maximum(a, b) + reach, origin=start)
            dx, dy, dz = b - a
            along = np.clip((x * dx + y * dy + z * dz) / max(float(dx * dx + dy * dy + dz * dz), 1e-9), 0, 1)
            distance = np.sqrt((x - along * dx) ** 2 + (y - along * dy) ** 2 + (z - along * dz) ** 2)
            self._merge(near, distance - (r0 + along * np.float32(r1 - r0)), blend=blend, cut=cut)

    def _near(
        self, low: np.ndarray, high: np.ndarray, *, origin: Vector
    ) -> tuple[tuple[slice, ...], tuple[np.ndarray, np.ndarray, np.ndarray]]:
        spans = zip(self.axes, low, high, strict=True)
        near = tuple(slice(*np.searchsorted(axis, (a, b))) for axis, a, b in spans)
        local = [axis[part] - np.float32(o) for axis, part, o in zip(self.axes, near, origin, strict=True)]
        x, y, z = np.meshgrid(*local, indexing="ij", sparse=True)
        return near, (x, y, z)

    def _merge(self, near: tuple[slice, ...], distance: np.ndarray, *, blend: float, cut: bool) -> None:
        """Polynomial smooth minimum (Quilez): the overlap of the two fields, squared, rounds the seam."""
        sign = np.float32(-1 if cut else 1)
        here = sign * self.field[near]
        overlap = np.maximum(blend - np.abs(here - distance), 0)
        self.field[near] = sign * (np.minimum(here, distance) - overlap * overlap * np.float32(0.25 / blend))

    def mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (n, 3) and outward triangles (m, 3) of the surface. What leaves the grid is open there."""
        vertices, triangles = surface_nets(self.field)
        return vertices * self.cell + np.array([axis[0] for axis in self.axes]), triangles


def surface_nets(field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Zero level of a field (negative inside) as vertices (n, 3), in cells, and outward triangles (m, 3).

    Naive surface nets (Gibson 1998, doi:10.1007/BFb0056277): one vertex a cell that the surface crosses, the
    mean of the crossings on its edges; one quad a crossed grid edge. Edges in the faces of the grid are left out.
    """
    cells = np.array(field.shape) - 1
    inside = field < 0
    total = np.zeros((*cells, 3), dtype=np.float32)
    crossings = np.zeros(cells, dtype=np.float32)
    edges = []
    for axis in range(3):
        inner = [slice(1, -1)] * 3
        lower, upper = list(inner), list(inner)
        lower[axis], upper[axis] = slice(0, -1), slice(1, None)
        at = np.argwhere(inside[tuple(lower)] != inside[tuple(upper)])
        at += np.array([0 if a == axis else 1 for a in range(3)])
        end = at + np.eye(3, dtype=at.dtype)[axis]
        f0, f1 = field[tuple(at.T)], field[tuple(end.T)]
        point = at.astype(np.float32)
        point[:, axis] += f0 / (f0 - f1)
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for du in (0, 1):
            for dv in (0, 1):
                cell = at.copy()
                cell[:, u] -= du
                cell[:, v] -= dv
                # Edges along one axis at one corner meet a cell at most once: plain indexing adds right.
                total[tuple(cell.T)] += point
                crossings[tuple(cell.T)] += 1
        edges.append((axis, at, f0 < 0))
    used = crossings > 0
    index = np.full(cells, -1, dtype=np.int64)
    index[used] = np.arange(used.sum())
    vertices = total[used] / crossings[used][:, None]
    triangles = []
    for axis, at, leaves in edges:
        u, v = (axis + 1) % 3, (axis + 2) % 3
        corner = []
        for du, dv in ((1, 1), (0, 1), (0, 0), (1, 0)):
            cell = at.copy()
            cell[:, u] -= du
            cell[:, v] -= dv
            corner.append(index[tuple(cell.T)])
        quad = np.stack(corner, axis=1)
        quad[~leaves] = quad[~leaves][:, ::-1]
        triangles += [quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]
    return vertices.astype(np.float64), np.concatenate(triangles)
