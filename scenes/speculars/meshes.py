"""Triangles in metres: grids, turned and lofted bodies, and the Mitsuba meshes made of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np
from saf_gen.render.meshes import make_mesh


@dataclass(frozen=True)
class Body:
    """Vertices (n, 3) in metres, triangles (m, 3), texture coordinates (n, 2)."""

    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray

    def moved(self, shift: Any, *, yaw_deg: float = 0.0, pitch_deg: float = 0.0) -> Body:
        """Turned about x, then about the vertical, then shifted."""
        a, b = np.radians([pitch_deg, yaw_deg])
        about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
        about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
        return Body(self.vertices @ (about_y @ about_x).T + np.asarray(shift), self.triangles, self.uv)


def joined(bodies: list[Body]) -> Body:
    """All bodies as one."""
    first = np.cumsum([0] + [len(b.vertices) for b in bodies])
    triangles = [b.triangles + start for b, start in zip(bodies, first[:-1], strict=True)]
    return Body(
        np.concatenate([b.vertices for b in bodies]),
        np.concatenate(triangles),
        np.concatenate([b.uv for b in bodies]),
    )


def grid(points: np.ndarray) -> Body:
    """Quads of a (rows, columns, 3) array of points; u runs along the columns, v along the rows, 0..1."""
    rows, columns = points.shape[:2]
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    halves = [(first, first + 1, first + columns + 1), (first, first + columns + 1, first + columns)]
    u, v = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    triangles = np.concatenate([np.stack(half, axis=1) for half in halves])
    return Body(points.reshape(-1, 3).astype(np.float64), triangles, np.stack([u, v], 2).reshape(-1, 2))


def turned(outline: Any, *, around: int = 96, steps: int = 12) -> Body:
    """Surface of revolution about y of (radius, height) knots, rounded between them."""
    knots = np.asarray(outline, dtype=np.float64)
    fine = np.linspace(0, len(knots) - 1, (len(knots) - 1) * steps + 1)
    outline = np.stack([_rounded(fine, knots[:, k]) for k in (0, 1)], axis=1)
    angle = np.linspace(0, 2 * np.pi, around + 1)
    ring = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=1)
    return grid(np.maximum(outline[:, 0], 0)[:, None, None] * ring + outline[:, 1, None, None] * [0, 1.0, 0])


def _rounded(at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Catmull-Rom through values at 0, 1, 2, ..."""
    k = np.minimum(at.astype(int), len(values) - 2)
    t = at - k
    p = np.concatenate([2 * values[:1] - values[1:2], values, 2 * values[-1:] - values[-2:-1]])
    a, b, c, d = p[k], p[k + 1], p[k + 2], p[k + 3]
    return b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))


def faceted_ball(rings: int, around: int) -> Body:
    """A ball of radius 1 with flat facets, no vertex shared."""
    lat, lon = np.linspace(-np.pi / 2, np.pi / 2, rings + 1), np.linspace(0, 2 * np.pi, around + 1)
    points = np.stack(np.broadcast_arrays(
        np.cos(lat)[:, None] * np.cos(lon), np.sin(lat)[:, None] + 0 * lon, np.cos(lat)[:, None] * np.sin(lon)
    ), axis=2)  # fmt: skip
    made = grid(points[:, ::-1])
    corners = made.vertices[made.triangles]
    wide = (
        np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) > 1e-6
    )
    kept = made.triangles[wide].ravel()
    return Body(made.vertices[kept], np.arange(kept.size).reshape(-1, 3), made.uv[kept])


def mesh(name: str, made: Body, bsdf: Any, *, smooth: bool = True) -> mi.Mesh:
    """The body as a Mitsuba mesh with its own id; ``bsdf`` is loaded, and may be shared."""
    return make_mesh(name, made.vertices, faces=made.triangles, bsdf=bsdf, uv=made.uv, smooth=smooth)


def texture(picture: np.ndarray, repeat: tuple[float, float] = (1.0, 1.0)) -> dict[str, Any]:
    """A picture, row 0 on top, so many times across and up the coordinates."""
    rows = np.ascontiguousarray(picture[::-1], dtype=np.float32)
    scale = mi.ScalarTransform4f().scale([*repeat, 1])
    return {"type": "bitmap", "bitmap": mi.Bitmap(rows), "raw": True, "to_uv": scale}
