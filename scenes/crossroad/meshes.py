"""Triangles in life-size metres: simple bodies, lofts, and the Mitsuba meshes made of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.render.meshes import make_mesh

Vector = tuple[float, float, float]

BOX_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float64)
BOX_QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


@dataclass(frozen=True)
class Body:
    """Vertices (n, 3) in metres, triangles (m, 3), texture coordinates (n, 2), tones (n,) in 0..1."""

    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray
    tone: np.ndarray

    def moved(self, shift: Vector | np.ndarray, turn_deg: float = 0.0, scale: float = 1.0) -> Body:
        """Scaled, turned about the vertical, then shifted."""
        c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        return Body(self.vertices * scale @ turn.T + np.asarray(shift), self.triangles, self.uv, self.tone)


def body(vertices: Any, triangles: Any, *, uv: Any = None, tone: Any = 0.5) -> Body:
    """A body from arrays; one tone for all where a number is given."""
    points = np.asarray(vertices, dtype=np.float64)
    flat = np.zeros((len(points), 2)) if uv is None else np.asarray(uv, dtype=np.float64)
    return Body(points, np.asarray(triangles, dtype=np.int64), flat, np.broadcast_to(tone, len(points)))


def joined(bodies: list[Body]) -> Body:
    """All bodies as one."""
    first = np.cumsum([0] + [len(b.vertices) for b in bodies])
    triangles = [b.triangles + start for b, start in zip(bodies, first[:-1], strict=True)]
    return Body(
        np.concatenate([b.vertices for b in bodies]),
        np.concatenate(triangles),
        np.concatenate([b.uv for b in bodies]),
        np.concatenate([b.tone for b in bodies]),
    )


def box(low: Vector, high: Vector, tone: float = 0.5) -> Body:
    """An upright box between two corners; its texture is laid on in metres, as on every flat part."""
    corners = np.asarray(low) + BOX_CORNERS * (np.asarray(high) - np.asarray(low))
    return joined([quad(*corners[list(side)], tone=tone) for side in BOX_QUADS])


def quad(a: Any, b: Any, c: Any, d: Any, *, tone: float = 0.5, uv: Any = None) -> Body:
    """A flat quadrilateral a, b, c, d, counter-clockwise as its front sees it.

    Without ``uv`` the texture coordinates are metres along the two world axes that it spans most.
    """
    points = np.array([a, b, c, d], dtype=np.float64)
    if uv is None:
        spans = points.max(axis=0) - points.min(axis=0)
        across, up = ((2, 1), (0, 2), (0, 1))[int(spans.argmin())]
        uv = points[:, [across, up]]
    return body(points, [[0, 1, 2], [0, 2, 3]], uv=uv, tone=tone)


def grid(points: np.ndarray, *, tone: Any = 0.5, uv: np.ndarray | None = None) -> Body:
    """Quads of a (rows, columns, 3) array of points, in triangles; neighbours share vertices."""
    rows, columns = points.shape[:2]
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    halves = [(first, first + 1, first + columns + 1), (first, first + columns + 1, first + columns)]
    triangles = np.concatenate([np.stack(half, axis=1) for half in halves])
    tones = np.broadcast_to(tone, (rows, columns)).ravel()
    flat = None if uv is None else uv.reshape(-1, 2)
    return body(points.reshape(-1, 3), triangles, uv=flat, tone=tones)


def tube(path: Any, radius: Any, *, around: int = 12, tone: Any = 0.5, flat: float = 1.0) -> Body:
    """A closed tube along points (n, 3) with a radius at each; ``flat`` scales it along the world's z."""
    centres = np.asarray(path, dtype=np.float64)
    radii = np.broadcast_to(radius, len(centres)).astype(np.float64)
    along = np.gradient(centres, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.where(np.abs(along[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    side = np.cross(along, aside)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(side, along)
    angle = np.linspace(0, 2 * np.pi, around + 1)
    ring = np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * other[:, None] * flat
    points = centres[:, None] + radii[:, None, None] * ring
    points = np.concatenate([np.repeat(centres[:1, None], around + 1, 1), points])
    points = np.concatenate([points, np.repeat(centres[-1:, None], around + 1, 1)])
    tones = np.broadcast_to(np.asarray(tone).reshape(-1, 1), (len(centres), around + 1))
    return grid(points, tone=np.concatenate([tones[:1], tones, tones[-1:]]))


def turned(outline: Any, centre: Vector, *, around: int = 20, tone: Any = 0.5) -> Body:
    """Surface of revolution of (radius, height) pairs about the vertical through ``centre``."""
    knots = np.asarray(outline, dtype=np.float64)
    angle = np.linspace(0, 2 * np.pi, around + 1)
    ring = np.stack([np.cos(angle), np.zeros_like(angle), -np.sin(angle)], axis=1)
    points = knots[:, 0, None, None] * ring + knots[:, 1, None, None] * np.array([0.0, 1.0, 0.0])
    tones = np.broadcast_to(np.asarray(tone).reshape(-1, 1), points.shape[:2])
    return grid(points + np.asarray(centre), tone=tones)


def mesh(name: str, made: Body, bsdf: Any, *, smooth: bool = False) -> mi.Mesh:
    """The body as a Mitsuba mesh with its own id; ``bsdf`` is a description or a loaded one, to be shared."""
    return make_mesh(name, made.vertices, faces=made.triangles, bsdf=bsdf, uv=made.uv, smooth=smooth)


def toned(made: Body) -> Body:
    """The body with its tones as texture coordinates of :func:`matte`."""
    return Body(made.vertices, made.triangles, np.stack([made.tone, np.full(len(made.tone), 0.5)], 1), made.tone)


def matte() -> Any:
    """Diffuse, for every :func:`toned` body: its picture is a ramp, whose value at u is u.

    One surface for all shapes, loaded: Mitsuba's start-up time grows with the number of surfaces.
    """
    ramp = np.broadcast_to((np.arange(64) + 0.5) / 64, (2, 64))
    return mi.load_dict(painted(ramp))


def painted(picture: np.ndarray, *, tile_m: tuple[float, float] = (1.0, 1.0)) -> dict[str, Any]:
    """Diffuse with a picture (row 0 on top) whose width and height cover ``tile_m`` of the coordinates."""
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": texture(picture, tile_m)}}


def glossy(picture: np.ndarray | float, *, alpha: float, tile_m: tuple[float, float] = (1.0, 1.0)) -> dict[str, Any]:
    """A clear coat over a picture or one tone: car paint, window glass, glazed tiles."""
    under = picture if isinstance(picture, float) else texture(picture, tile_m)
    coat = {"type": "roughplastic", "diffuse_reflectance": under, "alpha": alpha, "int_ior": 1.5}
    return {"type": "twosided", "bsdf": coat}


def texture(picture: np.ndarray, tile_m: tuple[float, float]) -> dict[str, Any]:
    """A reflectance picture, repeated; a bitmap's first row lies at v = 0, the picture's at its top."""
    rows = np.ascontiguousarray(picture[::-1], dtype=np.float32)
    scale = mi.ScalarTransform4f().scale([1 / tile_m[0], 1 / tile_m[1], 1])
    return {"type": "bitmap", "bitmap": mi.Bitmap(rows), "raw": True, "to_uv": scale}
