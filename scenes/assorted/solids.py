"""Bodies of triangles, in any unit: grids, boxes, balls, tubes, turned bodies; how they are joined and placed."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np


class Body(NamedTuple):
    """Vertices (n, 3), triangles (m, 3), texture coordinates (n, 2), reflectances (n,) in 0..1."""

    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray
    tone: np.ndarray


def grid(points: Any, *, uv: np.ndarray | None = None, tone: Any = 0.5) -> Body:
    """Quads of points (rows, columns, 3), two triangles each; u runs along the columns, v along the rows, 0..1.

    Seen so that columns run to the right and rows upwards, the front is towards the viewer.
    """
    points = np.asarray(points, dtype=np.float64)
    rows, columns = points.shape[:2]
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    halves = [(first, first + 1, first + columns + 1), (first, first + columns + 1, first + columns)]
    triangles = np.concatenate([np.stack(half, axis=1) for half in halves])
    if uv is None:
        uv = np.stack(np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows)), axis=2)
    tones = np.broadcast_to(np.asarray(tone, dtype=np.float64), (rows, columns)).ravel()
    return Body(points.reshape(-1, 3), triangles, uv.reshape(-1, 2), tones)


def joined(bodies: list[Body]) -> Body:
    """All bodies as one."""
    first = np.cumsum([0] + [len(b.vertices) for b in bodies])
    triangles = [b.triangles + start for b, start in zip(bodies, first[:-1], strict=True)]
    vertices, uv, tone = (np.concatenate([getattr(b, part) for b in bodies]) for part in ("vertices", "uv", "tone"))
    return Body(vertices, np.concatenate(triangles), uv, tone)


def turning(axis: Any, angle_deg: float) -> np.ndarray:
    """Rotation (3, 3) about an axis through the origin, counter-clockwise for who looks against it (Rodrigues)."""
    x, y, z = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(angle_deg)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)


def placed(body: Body, shift: Any = (0, 0, 0), *, turn: np.ndarray | None = None, scale: Any = 1.0) -> Body:
    """Scaled, turned by a matrix (3, 3), shifted. A scale with a negative product is a mirror, and keeps fronts out."""
    factors = np.broadcast_to(np.asarray(scale, dtype=np.float64), 3)
    matrix = (np.eye(3) if turn is None else turn) * factors
    triangles = body.triangles if np.prod(factors) > 0 else body.triangles[:, ::-1]
    return body._replace(vertices=body.vertices @ matrix.T + np.asarray(shift), triangles=triangles)


def box(low: Any, high: Any, *, tone: float = 0.5) -> Body:
    """An upright box with flat faces, no vertex shared among them; every face has 0..1 as its coordinates."""
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    faces = []
    for normal in range(3):
        u, v = (normal + 1) % 3, (normal + 2) % 3
        for side in (0, 1):
            corners = np.empty((2, 2, 3))
            corners[..., normal] = (low, high)[side][normal]
            corners[..., u] = [[low[u], high[u]]] * 2 if side else [[high[u], low[u]]] * 2
            corners[..., v] = [[low[v]] * 2, [high[v]] * 2]
            faces.append(grid(corners, tone=tone))
    return joined(faces)


def ball(centre: Any, radii: Any, *, rings: int = 16, around: int = 32, tone: Any = 0.5) -> Body:
    """An ellipsoid, its poles along y; u runs eastwards from behind (-z), v from the lower pole to the upper."""
    lat, lon = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)[:, None], np.linspace(-np.pi, np.pi, around + 1)
    unit = np.stack([np.cos(lat) * np.sin(lon), np.sin(lat) + 0 * lon, np.cos(lat) * np.cos(lon)], axis=2)
    return grid(unit * np.broadcast_to(np.asarray(radii), 3) + np.asarray(centre), tone=tone)


def turned(outline: Any, *, around: int = 96, tone: Any = 0.5) -> Body:
    """Surface of revolution about y of (radius, height) pairs, outside from below upwards; v by length of outline."""
    outline = np.asarray(outline, dtype=np.float64)
    radius, height = outline.T[:, :, None]
    angle = np.linspace(0, 2 * np.pi, around + 1)
    points = np.stack([radius * np.sin(angle), height + 0 * angle, radius * np.cos(angle)], axis=2)
    way = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(outline, axis=0).T))])
    uv = np.stack(np.broadcast_arrays(angle / (2 * np.pi), way[:, None] / way[-1]), axis=2)
    return grid(points, uv=uv, tone=tone)


def rounded(knots: Any, *, steps: int = 8) -> np.ndarray:
    """A smooth curve (m, d) through knots (n, d), so many steps from one to the next (Catmull-Rom)."""
    p = np.asarray(knots, dtype=np.float64)
    at = np.linspace(0, len(p) - 1, (len(p) - 1) * steps + 1)
    k = np.minimum(at.astype(int), len(p) - 2)
    t = (at - k)[:, None]
    p = np.concatenate([2 * p[:1] - p[1:2], p, 2 * p[-1:] - p[-2:-1]])
    a, b, c, d = p[k], p[k + 1], p[k + 2], p[k + 3]
    return b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))


def tube(path: Any, radius: Any, *, around: int = 12, flat: float = 1.0, tone: Any = 0.5) -> Body:
    """A tapering tube along points (n, 3) with closed, rounded ends; u runs round it, v along it.

    radius : a number, or one for each point. flat : thickness over width, across the first bend's plane.
    tone : a number, or one for each point.
    """
    path = np.asarray(path, dtype=np.float64)
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.empty_like(path)
    start = np.eye(3)[np.argmin(np.abs(along[0]))]
    for k, way in enumerate(along):  # the frame is carried along without twisting
        start = start - way * (start @ way)
        start = start / np.linalg.norm(start)
        side[k] = start
    other = np.cross(along, side)
    radius = np.broadcast_to(np.asarray(radius, dtype=np.float64), len(path))
    order = np.concatenate([[0, 0], np.arange(len(path)), [-1, -1]])
    out = np.concatenate([[0.0, 0.7], np.ones(len(path)), [0.7, 0.0]]) * radius[order]
    beyond = np.concatenate([[-1.0, -0.7], np.zeros(len(path)), [0.7, 1.0]]) * radius[order]
    middle = path[order] + along[order] * beyond[:, None]
    angle = np.linspace(0, 2 * np.pi, around + 1)[:, None]
    ring = np.cos(angle) * side[order][:, None] + flat * np.sin(angle) * other[order][:, None]
    tones = np.broadcast_to(np.asarray(tone, dtype=np.float64), len(path))[order]
    return grid(middle[:, None] + out[:, None, None] * ring, tone=tones[:, None])
