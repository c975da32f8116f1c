"""Triangles in metres: boxes, tubes, turned bodies, lofts, and the Mitsuba meshes made of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.render.meshes import make_mesh

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float64)
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


@dataclass(frozen=True)
class Body:
    """Vertices (n, 3) in metres, triangles (m, 3), texture coordinates (n, 2).

    A body of one tone has that tone as its coordinate u: see :func:`matte`.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray

    def moved(self, shift: Any, turn_deg: float = 0.0, scale: Any = 1.0) -> Body:
        """Scaled, turned about the vertical, then shifted."""
        c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        return Body(self.vertices * np.asarray(scale) @ turn.T + np.asarray(shift), self.triangles, self.uv)


def joined(bodies: list[Body]) -> Body:
    """All bodies as one."""
    first = np.cumsum([0] + [len(b.vertices) for b in bodies])
    triangles = [b.triangles + start for b, start in zip(bodies, first[:-1], strict=True)]
    return Body(
        np.concatenate([b.vertices for b in bodies]), np.concatenate(triangles), np.concatenate([b.uv for b in bodies])
    )


def quad(a: Any, b: Any, c: Any, d: Any, *, tone: float | None = None, uv: Any = None) -> Body:
    """A flat quadrilateral a, b, c, d; of one tone, with given coordinates, or with metres for them."""
    points = np.array([a, b, c, d], dtype=np.float64)
    if tone is not None:
        uv = np.full((4, 2), (tone, 0.5))
    elif uv is None:
        across, up = ((2, 1), (0, 2), (0, 1))[int((points.max(axis=0) - points.min(axis=0)).argmin())]
        uv = points[:, [across, up]]
    return Body(points, np.array([[0, 1, 2], [0, 2, 3]]), np.asarray(uv, dtype=np.float64))


def box(low: Any, high: Any, tone: float) -> Body:
    """An upright box between two corners."""
    corners = np.asarray(low) + CORNERS * (np.asarray(high) - np.asarray(low))
    return joined([quad(*corners[list(side)], tone=tone) for side in SIDES])


def grid(points: np.ndarray, *, tone: Any) -> Body:
    """Quads of a (rows, columns, 3) array of points; a tone for all, or one a row."""
    rows, columns = points.shape[:2]
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    halves = [(first, first + 1, first + columns + 1), (first, first + columns + 1, first + columns)]
    tones = np.broadcast_to(np.asarray(tone, dtype=np.float64).reshape(-1, 1), (rows, columns)).ravel()
    uv = np.stack([tones, np.full_like(tones, 0.5)], axis=1)
    triangles = np.concatenate([np.stack(half, axis=1) for half in halves])
    return Body(points.reshape(-1, 3).astype(np.float64), triangles, uv)


def tube(path: Any, radius: Any, *, around: int = 10, tone: float = 0.05) -> Body:
    """A tube along points (n, 3), open at its ends."""
    centres = np.asarray(path, dtype=np.float64)
    radii = np.broadcast_to(radius, len(centres)).astype(np.float64)
    along = np.gradient(centres, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.where(np.abs(along[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    side = np.cross(along, aside)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    angle = np.linspace(0, 2 * np.pi, around + 1)
    ring = np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * np.cross(side, along)[:, None]
    return grid(centres[:, None] + radii[:, None, None] * ring, tone=tone)


def turned(outline: Any, centre: Any, *, around: int = 16, tone: Any = 0.05) -> Body:
    """Surface of revolution of (radius, height) pairs about the vertical through ``centre``."""
    knots = np.asarray(outline, dtype=np.float64)
    angle = np.linspace(0, 2 * np.pi, around + 1)
    ring = np.stack([np.cos(angle), np.zeros_like(angle), -np.sin(angle)], axis=1)
    points = knots[:, 0, None, None] * ring + knots[:, 1, None, None] * np.array([0.0, 1.0, 0.0])
    return grid(points + np.asarray(centre), tone=tone)


def mesh(name: str, made: Body, bsdf: Any, *, smooth: bool = False) -> mi.Mesh:
    """The body as a Mitsuba mesh with its own id; ``bsdf`` is a description or a loaded one, to be shared."""
    return make_mesh(name, made.vertices, faces=made.triangles, bsdf=bsdf, uv=made.uv, smooth=smooth)


def ramp() -> dict[str, Any]:
    """A texture whose value at u is u, so that coordinates carry tones."""
    return texture(np.broadcast_to((np.arange(64) + 0.5) / 64, (2, 64)))


def matte() -> Any:
    """Diffuse, in tones; loaded, to be shared."""
    return mi.load_dict({"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": ramp()}})


def glossy(alpha: float) -> Any:
    """Lacquer over tones; loaded, to be shared."""
    coat = {"type": "roughplastic", "diffuse_reflectance": ramp(), "alpha": alpha, "int_ior": 1.5}
    return mi.load_dict({"type": "twosided", "bsdf": coat})


def texture(picture: np.ndarray, tile_m: tuple[float, float] = (1.0, 1.0)) -> dict[str, Any]:
    """A picture, row 0 on top, whose width and height cover ``tile_m`` of the coordinates; it repeats."""
    rows = np.ascontiguousarray(picture[::-1], dtype=np.float32)
    scale = mi.ScalarTransform4f().scale([1 / tile_m[0], 1 / tile_m[1], 1])
    return {"type": "bitmap", "bitmap": mi.Bitmap(rows), "raw": True, "to_uv": scale}
