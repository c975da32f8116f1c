"""A carved two-humped camel: limbs of a signed distance field, blended, and meshed by surface nets.

Millimetres. The camel faces +x, y is up, the ground is y = 0 and z = 0 is its plane of symmetry.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

LENGTH_MM, HEIGHT_MM, WIDTH_MM = (-47.0, 77.0), (-2.0, 97.0), (-21.0, 21.0)
CELL_MM = 0.65
CHISEL_MM, CHISEL_PITCH_MM = 0.15, 3.4  # depth and spacing of the tool marks

# Chains of (x, y, z, radius): consecutive points are joined by a tapering limb. LIMBS are mirrored in z.
BODY = (
    ((-25, 50, 0, 14.5), (-8, 47, 0, 15.5), (10, 48, 0, 16.0), (25, 51, 0, 14.0)),
    ((-13, 58, 0, 10.5), (-15, 70, 0, 6.0), (-16, 76, 0, 3.6)),  # rear hump
    ((13, 59, 0, 10.5), (13, 72, 0, 6.0), (12, 79, 0, 3.6)),  # front hump
    ((28, 50, 0, 11.0), (41, 47, 0, 8.0), (50, 55, 0, 6.6), (54, 68, 0, 5.6), (54, 81, 0, 5.2)),  # neck
    ((54, 84, 0, 6.6), (62, 83.5, 0, 5.6), (68, 81, 0, 4.4), (71.5, 79, 0, 4.2)),  # head and muzzle
    ((70, 75.8, 0, 2.6), (62, 78, 0, 3.6)),  # lower jaw
    ((-38, 54, 0, 2.6), (-42.5, 44, 0, 2.0), (-42, 34, 0, 1.8), (-41, 28, 0, 2.7)),  # tail and tuft
)
LIMBS = (
    ((22, 46, 7, 8.0), (23, 27, 7.6, 4.3), (22, 8, 7.6, 3.0), (22, 3.2, 7.6, 3.4)),  # fore leg
    ((21, 2.6, 7.8, 3.9), (26, 2.2, 8.4, 3.4)),  # fore foot
    ((-24, 47, 7, 10.5), (-20, 31, 8.0, 6.0), (-28, 22, 8.0, 3.9), (-26, 8, 8.0, 3.0), (-26, 3.2, 8.0, 3.4)),
    ((-27, 2.6, 8.2, 3.9), (-22, 2.2, 8.8, 3.4)),  # hind foot
    ((52.0, 87, 4.0, 2.4), (50.0, 91, 5.6, 2.1), (47.5, 94, 6.8, 1.0)),  # ear
    ((59.5, 86.2, 4.4, 1.5), (60.0, 86.0, 4.4, 1.5)),  # eye
)
BLEND_MM, FINE_BLEND_MM, FINE_RADIUS_MM = 6.0, 1.6, 3.0  # thin ends blend over less, or they melt


def camel() -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) float32 in mm and outward triangles (m, 3) uint32 of the figurine."""
    axes = [np.arange(low, high, CELL_MM, dtype=np.float32) for low, high in (LENGTH_MM, HEIGHT_MM, WIDTH_MM)]
    field = np.full([axis.size for axis in axes], 10.0, dtype=np.float32)
    mirrored = tuple(tuple((x, y, -z, r) for x, y, z, r in chain) for chain in LIMBS)
    for chain in (*BODY, *LIMBS, *mirrored):
        for (*start, r0), (*stop, r1) in pairwise(chain):
            _blend_limb(field, axes, np.array(start), np.array(stop), r0, r1)
    vertices, triangles = surface_nets(field)
    vertices = vertices * CELL_MM + np.array([axis[0] for axis in axes])
    return _chiselled(vertices).astype(np.float32), triangles


def _blend_limb(
    field: np.ndarray, axes: list[np.ndarray], start: np.ndarray, stop: np.ndarray, r0: float, r1: float
) -> None:
    """Smooth union, in place, of a tapering capsule; only where it can move the surface."""
    blend = BLEND_MM if min(r0, r1) > FINE_RADIUS_MM else FINE_BLEND_MM
    reach = max(r0, r1) + blend + 2 * CELL_MM
    spans = np.stack([np.minimum(start, stop) - reach, np.maximum(start, stop) + reach], axis=1)
    near = tuple(slice(*np.searchsorted(axis, span)) for axis, span in zip(axes, spans, strict=True))
    local = [axis[part] - np.float32(o) for axis, part, o in zip(axes, near, start, strict=True)]
    x, y, z = np.meshgrid(*local, indexing="ij", sparse=True)
    dx, dy, dz = (stop - start).astype(np.float32)
    along = np.clip((x * dx + y * dy + z * dz) / (dx * dx + dy * dy + dz * dz), 0, 1)
    distance = np.sqrt((x - along * dx) ** 2 + (y - along * dy) ** 2 + (z - along * dz) ** 2)
    distance -= r0 + along * np.float32(r1 - r0)
    # Polynomial smooth minimum (Quilez): the overlap of the two fields, squared, rounds the crease.
    overlap = np.maximum(blend - np.abs(field[near] - distance), 0)
    field[near] = np.minimum(field[near], distance) - overlap * overlap * np.float32(0.25 / blend)


def surface_nets(field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Zero level of a field (negative inside) as vertices (n, 3), in cells, and outward triangles (m, 3).

    Naive surface nets (Gibson 1998, doi:10.1007/BFb0056277): one vertex a cell that the surface crosses, the
    mean of the crossings on its edges; one quad a crossed grid edge.
    """
    cells = np.array(field.shape) - 1
    inside = field < 0
    total = np.zeros((*cells, 3), dtype=np.float32)
    crossings = np.zeros(cells, dtype=np.float32)
    edges = []
    for axis in range(3):
        lower = tuple(slice(0, -1) if a == axis else slice(None) for a in range(3))
        upper = tuple(slice(1, None) if a == axis else slice(None) for a in range(3))
        at = np.argwhere(inside[lower] != inside[upper])
        f0, f1 = field[lower][tuple(at.T)], field[upper][tuple(at.T)]
        point = at.astype(np.float32)
        point[:, axis] += f0 / (f0 - f1)
        edges.append((axis, at, f0 < 0))
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for du in (0, 1):
            for dv in (0, 1):
                cell = at.copy()
                cell[:, u] -= du
                cell[:, v] -= dv
                # Edges along one axis at one corner meet a cell at most once: plain indexing adds right.
                total[tuple(cell.T)] += point
                crossings[tuple(cell.T)] += 1
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
    return vertices, np.concatenate(triangles).astype(np.uint32)


def _chiselled(vertices: np.ndarray) -> np.ndarray:
    """Shallow, irregular tool marks: three crossed waves whose phases drift over the body."""
    x, y, z = vertices.T * (2 * np.pi / CHISEL_PITCH_MM)
    drift = [np.sin(0.31 * y + 0.17 * z), np.sin(0.23 * z + 0.29 * x), np.sin(0.27 * x + 0.19 * y)]
    phase = np.stack([0.8 * y + 0.5 * z, 0.7 * z + 0.6 * x, 0.9 * x - 0.4 * y]) + 2 * np.stack(drift)
    return vertices + CHISEL_MM * np.sin(phase).T
