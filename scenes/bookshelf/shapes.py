"""What the scene's parts are made of: meshes, sheets, boxes, lamps, and matt or satin surfaces."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.render.meshes import make_mesh

Vector = tuple[float, float, float]


def matte(reflectance: np.ndarray | float) -> dict[str, Any]:
    """Diffuse, seen from both sides; a picture's first row is the top of the surface."""
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": _texture(reflectance)}}


def satin(reflectance: np.ndarray | float, roughness: float) -> dict[str, Any]:
    """Varnish over a diffuse ground."""
    coat = {"type": "roughplastic", "diffuse_reflectance": _texture(reflectance), "alpha": roughness}
    return {"type": "twosided", "bsdf": coat}


def _texture(reflectance: np.ndarray | float) -> dict[str, Any] | float:
    if not isinstance(reflectance, np.ndarray):
        return reflectance
    bottom_up = np.ascontiguousarray(reflectance[::-1], dtype=np.float32)  # a bitmap begins at v = 0
    return {"type": "bitmap", "bitmap": mi.Bitmap(bottom_up), "raw": True, "wrap_mode": "clamp"}


def box(low: Vector, high: Vector, bsdf: dict[str, Any]) -> dict[str, Any]:
    """Box between two corners (m); each face wears the whole picture."""
    middle, half = (np.add(low, high) / 2).tolist(), (np.subtract(high, low) / 2).tolist()
    pose = mi.ScalarTransform4f().translate(middle).scale(half)
    return {"type": "cube", "to_world": pose, "bsdf": bsdf}


def panel(origin: Vector, towards: Vector, size: tuple[float, float], radiance: float) -> dict[str, Any]:
    """A lamp: a rectangle of even radiance (W m^-2 sr^-1) that faces a point."""
    pose = mi.ScalarTransform4f().look_at(origin=list(origin), target=list(towards), up=[0, 0.1, 1])
    return {
        "type": "rectangle",
        "to_world": pose @ mi.ScalarTransform4f().scale([size[0] / 2, size[1] / 2, 1]),
        "bsdf": {"type": "diffuse", "reflectance": 0.0},
        "emitter": {"type": "area", "radiance": radiance},
    }


def swept(name: str, rings: np.ndarray, bsdf: dict[str, Any]) -> mi.Mesh:
    """Surface through rings of points, (ring, point, 3) in metres; u runs round a ring, v across them."""
    count, points = rings.shape[:2]
    v, u = np.meshgrid(np.linspace(0, 1, count), np.linspace(0, 1, points), indexing="ij")
    first = (np.arange(count - 1)[:, None] * points + np.arange(points - 1)).ravel()
    halves = [(first, first + 1, first + points + 1), (first, first + points + 1, first + points)]
    faces = np.concatenate([np.stack(half, axis=1) for half in halves])
    return mesh(name, rings.reshape(-1, 3), faces, np.stack([u.ravel(), v.ravel()], axis=1), bsdf, smooth=True)


def turned(outline: list[tuple[float, float]], foot: Vector, around: int = 64) -> np.ndarray:
    """Rings of an outline of (radius, height) in metres turned about the vertical through `foot`."""
    radius, height = np.array(outline).T
    angle = np.linspace(0, 2 * np.pi, around + 1)
    ring = np.stack([np.cos(angle), np.zeros_like(angle), -np.sin(angle)], axis=1)
    return radius[:, None, None] * ring + height[:, None, None] * [0, 1, 0] + np.array(foot)


def mesh(
    name: str, points: np.ndarray, faces: np.ndarray, uv: np.ndarray, bsdf: dict[str, Any], *, smooth: bool
) -> mi.Mesh:
    """Triangle mesh in metres; its id is its name."""
    return make_mesh(name, points, faces=faces, bsdf=bsdf, uv=uv, smooth=smooth)
