"""Triangles in metres: tubes and many copies of one sheet, and the Mitsuba meshes made of them."""

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


def joined(bodies: list[Body]) -> Body:
    """All bodies as one."""
    first = np.cumsum([0] + [len(b.vertices) for b in bodies])
    triangles = [b.triangles + start for b, start in zip(bodies, first[:-1], strict=True)]
    return Body(
        np.concatenate([b.vertices for b in bodies]), np.concatenate(triangles), np.concatenate([b.uv for b in bodies])
    )


def quads(rows: int, columns: int) -> np.ndarray:
    """Triangles of a grid of rows × columns vertices."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    halves = [(first, first + 1, first + columns + 1), (first, first + columns + 1, first + columns)]
    return np.concatenate([np.stack(half, axis=1) for half in halves])


def tube(path: np.ndarray, radius: np.ndarray, *, around: int = 8, tone: float = 0.1) -> Body:
    """A tube along points (n, 3) with a radius at each; its coordinate u is its tone, for matte()."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.where(np.abs(along[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    side = np.cross(along, aside)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    angle = np.linspace(0, 2 * np.pi, around + 1)
    ring = np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * np.cross(side, along)[:, None]
    points = path[:, None] + radius[:, None, None] * ring
    # Bark: rings and lengthwise furrows of the tone, a pattern that is the same for every seed.
    mottle = np.sin(41.0 * np.arange(len(path)) ** 1.3)[:, None] * np.sin(3 * angle + 1.7 * len(path))
    tones = tone * (1 + 0.35 * mottle + 0.15 * np.sin(2.3 * np.arange(len(path)))[:, None])
    uv = np.stack([np.clip(tones, 0.02, 0.9), np.full_like(tones, 0.5)], axis=2)
    return Body(points.reshape(-1, 3), quads(*points.shape[:2]), uv.reshape(-1, 2))


def copies(sheet: Body, places: np.ndarray, frames: np.ndarray, sizes: np.ndarray, uv: np.ndarray) -> Body:
    """A sheet once at each of n places (n, 3).

    frames : (n, 3, 3), rows are where the sheet's x, y and z axes point. sizes : (n,). uv : (n, vertices, 2).
    """
    points = np.einsum("vi,nij->nvj", sheet.vertices, frames) * sizes[:, None, None] + places[:, None]
    count = len(sheet.vertices)
    triangles = sheet.triangles[None] + count * np.arange(len(places))[:, None, None]
    return Body(points.reshape(-1, 3), triangles.reshape(-1, 3), uv.reshape(-1, 2))


def mesh(name: str, made: Body, bsdf: Any) -> mi.Mesh:
    """The body as a smooth Mitsuba mesh with its own id; ``bsdf`` is loaded, and may be shared."""
    return make_mesh(name, made.vertices, faces=made.triangles, bsdf=bsdf, uv=made.uv, smooth=True)


def matte() -> Any:
    """Diffuse, loaded; its picture is a ramp whose value at u is u, so that coordinates carry tones."""
    ramp = np.broadcast_to((np.arange(64, dtype=np.float32) + 0.5) / 64, (2, 64))
    return mi.load_dict({"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": texture(np.array(ramp))}})


def texture(picture: np.ndarray) -> dict[str, Any]:
    """A picture with row 0 at v = 0."""
    return {"type": "bitmap", "bitmap": mi.Bitmap(np.ascontiguousarray(picture)), "raw": True}
