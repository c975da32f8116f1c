"""Matt surfaces of revolution, a paper sweep, and soft boxes."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.render.meshes import make_mesh

Vector = tuple[float, float, float]


def outline(knots_mm: list[tuple[float, float]], pieces: int) -> np.ndarray:
    """Smooth curve through (radius, height) in mm, in so many pieces a knot; float64 (n, 2) in metres."""
    points = np.array(knots_mm) * 1e-3
    at = np.linspace(0, len(points) - 1, pieces * (len(points) - 1) + 1)
    first = np.minimum(at.astype(int), len(points) - 2)
    t = (at - first)[:, None]
    slope = np.gradient(points, axis=0)
    a, b, ta, tb = points[first], points[first + 1], slope[first], slope[first + 1]
    smooth = a + t * (ta + t * (3 * (b - a) - 2 * ta - tb + t * (2 * (a - b) + ta + tb)))
    return np.maximum(smooth, 0)


def egg(length_m: float, width_m: float, pieces: int = 64) -> np.ndarray:
    """Outline of an egg from its blunt end, (radius, height) in metres, its middle at half its length."""
    angle = np.linspace(0, np.pi, pieces + 1)
    radius = width_m / 2 * np.sin(angle) * (1 + 0.11 * np.cos(angle))
    return np.stack([radius, length_m / 2 * (1 - np.cos(angle)) - length_m / 2], axis=1)


def turned(name: str, profile: np.ndarray, pose: Any, bsdf: dict[str, Any], around: int = 160) -> mi.Mesh:
    """Surface of revolution about the pose's y axis; u runs round it, v along the outline."""
    radius, height = profile.T
    angle = np.linspace(0, 2 * np.pi, around + 1)
    ring = np.stack([np.cos(angle), np.zeros_like(angle), -np.sin(angle)], axis=1)
    return _grid(name, radius[:, None, None] * ring + height[:, None, None] * [0, 1, 0], pose, bsdf)


def sweep(
    name: str, depth_m: float, radius_m: float, high_m: float, wide_m: float, pose: Any, bsdf: dict[str, Any]
) -> mi.Mesh:
    """Paper that lies on the table as far as the depth, bends upwards and hangs; its front edge is z = 0."""
    bend = np.linspace(0, np.pi / 2, 25)
    y = np.concatenate([[0.0], radius_m * (1 - np.cos(bend)), [high_m]])
    z = np.concatenate([[0.0], -depth_m - radius_m * np.sin(bend), [-depth_m - radius_m]])
    x = np.array([-wide_m / 2, wide_m / 2])
    points = np.stack(np.broadcast_arrays(x, y[:, None], z[:, None]), axis=-1)
    return _grid(name, points, pose, bsdf)


def _grid(name: str, points: np.ndarray, pose: Any, bsdf: dict[str, Any]) -> mi.Mesh:
    """Smooth mesh through a grid of points (row, column, 3); v grows with the length along the rows."""
    rows, columns = points.shape[:2]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=-1).mean(axis=1)
    along = np.concatenate([[0], np.cumsum(steps)]) / steps.sum()
    v, u = np.meshgrid(along, np.linspace(0, 1, columns), indexing="ij")
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    halves = [(first, first + 1, first + columns + 1), (first, first + columns + 1, first + columns)]
    matrix = np.array(pose.matrix, dtype=float)
    placed = points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    faces = np.concatenate([np.stack(half, axis=1) for half in halves])
    return make_mesh(name, placed, faces=faces, bsdf=bsdf, uv=uv, smooth=True)


def matte(reflectance: np.ndarray) -> dict[str, Any]:
    """Diffuse, seen from both sides; the picture's first row is the top of the surface."""
    bottom_up = np.ascontiguousarray(np.clip(reflectance, 0.02, 0.95)[::-1], dtype=np.float32)
    texture = {"type": "bitmap", "bitmap": mi.Bitmap(bottom_up), "raw": True}
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": texture}}


def panel(origin: Vector, towards: Vector, size: float, radiance: float) -> dict[str, Any]:
    """A soft box: a square of even radiance (W m^-2 sr^-1) that faces a point."""
    pose = mi.ScalarTransform4f().look_at(origin=list(origin), target=list(towards), up=[0, 1, 0])
    return {
        "type": "rectangle",
        "to_world": pose @ mi.ScalarTransform4f().scale([size / 2, size / 2, 1]),
        "bsdf": {"type": "diffuse", "reflectance": 0.0},
        "emitter": {"type": "area", "radiance": radiance},
    }
