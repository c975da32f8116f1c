"""What the scene's parts are made of: flat sheets, boxes, and matt or satin surfaces."""

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


def placed(centre: Vector, *turns: tuple[Vector, float]) -> Any:
    """Transform that turns by (axis, degrees), the last turn first, then moves to the centre (m)."""
    pose = mi.ScalarTransform4f().translate(list(centre))
    for axis, degrees in turns:
        pose = pose @ mi.ScalarTransform4f().rotate(list(axis), degrees)
    return pose


def sheet(pose: Any, width: float, height: float, bsdf: dict[str, Any]) -> dict[str, Any]:
    """Rectangle in the plane of x and y of its pose, facing +z."""
    size = mi.ScalarTransform4f().scale([width / 2, height / 2, 1])
    return {"type": "rectangle", "to_world": pose @ size, "bsdf": bsdf}


def box(pose: Any, size: Vector, bsdf: dict[str, Any]) -> dict[str, Any]:
    """Box of this size (m) about the pose's origin; each face wears the whole picture."""
    half = mi.ScalarTransform4f().scale([side / 2 for side in size])
    return {"type": "cube", "to_world": pose @ half, "bsdf": bsdf}


def panel(origin: Vector, towards: Vector, size: tuple[float, float], radiance: float) -> dict[str, Any]:
    """A lamp: a rectangle of even radiance (W m^-2 sr^-1) that faces a point."""
    pose = mi.ScalarTransform4f().look_at(origin=list(origin), target=list(towards), up=[0, 1, 0])
    return {
        **sheet(pose, *size, {"type": "diffuse", "reflectance": 0.0}),
        "emitter": {"type": "area", "radiance": radiance},
    }


def radiance_for(irradiance: float, origin: Vector, size: tuple[float, float], place: Vector, normal: Vector) -> float:
    """Radiance of a small panel, aimed at a place, that gives it this irradiance (W m^-2): E d²/(A cos)."""
    to_lamp = np.subtract(origin, place)
    distance = float(np.linalg.norm(to_lamp))
    cosine = float(to_lamp @ np.asarray(normal)) / distance
    return irradiance * distance**2 / (size[0] * size[1] * cosine)


def turned(name: str, outline: list[tuple[float, float]], pose: Any, bsdf: dict[str, Any], around: int = 48) -> mi.Mesh:
    """Surface of revolution about the pose's y axis; v runs along the outline of (radius, height) in m."""
    radius, height = np.array(outline).T
    along = np.concatenate([[0], np.cumsum(np.hypot(np.diff(radius), np.diff(height)))])
    angle = np.linspace(0, 2 * np.pi, around + 1)
    ring = np.stack([np.cos(angle), np.zeros_like(angle), -np.sin(angle)], axis=1)
    points = (radius[:, None, None] * ring + height[:, None, None] * [0, 1, 0]).reshape(-1, 3)
    v, u = np.meshgrid(along / along[-1], angle / (2 * np.pi), indexing="ij")
    first = (np.arange(len(radius) - 1)[:, None] * (around + 1) + np.arange(around)).ravel()
    above = first + around + 1
    halves = [(first, first + 1, above + 1), (first, above + 1, above)]
    matrix = np.array(pose.matrix, dtype=float)
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    faces = np.concatenate([np.stack(half, axis=1) for half in halves])
    placed = points @ matrix[:3, :3].T + matrix[:3, 3]
    return make_mesh(name, placed, faces=faces, bsdf=bsdf, uv=uv, smooth=True)
