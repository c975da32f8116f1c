"""Triangles and surfaces of the scene: rods, rings, turned bodies, sheets; metres."""

from __future__ import annotations

from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np

from saf_gen.render.meshes import make_mesh

Vector = tuple[float, float, float]


class Body(NamedTuple):
    """Vertices (n, 3) in metres, triangles (m, 3), texture coordinates (n, 2), tones (n,) in 0..1."""

    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray
    tone: np.ndarray


def grid(points: np.ndarray, *, uv: np.ndarray | None = None, tone: Any = 0.5) -> Body:
    """Quads of a (rows, columns, 3) array of points, two triangles each."""
    rows, columns = points.shape[:2]
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    halves = [(first, first + 1, first + columns + 1), (first, first + columns + 1, first + columns)]
    triangles = np.concatenate([np.stack(half, axis=1) for half in halves])
    flat = np.zeros((rows * columns, 2)) if uv is None else uv.reshape(-1, 2)
    return Body(points.reshape(-1, 3), triangles, flat, np.broadcast_to(tone, (rows, columns)).ravel())


def joined(bodies: list[Body]) -> Body:
    """All bodies as one."""
    first = np.cumsum([0] + [len(b.vertices) for b in bodies])
    triangles = [b.triangles + start for b, start in zip(bodies, first[:-1], strict=True)]
    parts = (np.concatenate([getattr(b, part) for b in bodies]) for part in ("vertices", "uv", "tone"))
    vertices, uv, tone = parts
    return Body(vertices, np.concatenate(triangles), uv, tone)


def ring(radius: float, z: float, wire: float, tone: np.ndarray, around: int = 10) -> Body:
    """A hoop of wire about the z axis; ``tone`` (n + 1,) runs along it and sets how finely it is cut."""
    a = np.linspace(0, 2 * np.pi, len(tone))[:, None]
    b = np.linspace(0, 2 * np.pi, around + 1)
    out = radius + wire / 2 * np.cos(b)
    points = np.stack([out * np.cos(a), out * np.sin(a), z + wire / 2 * np.sin(b) + 0 * a], axis=2)
    return grid(points, tone=tone[:, None])


def rod(path: np.ndarray, wire: float, tone: np.ndarray, around: int = 10) -> Body:
    """A round wire along points (n, 3), which must not run straight along y."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    reference = np.where(np.abs(along[:, 2:]) < 0.8, [[0.0, 0.0, 1.0]], [[0.0, 1.0, 0.0]])
    side = np.cross(along, reference)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(side, along)
    b = np.linspace(0, 2 * np.pi, around + 1)[:, None]
    points = path[:, None] + wire / 2 * (np.cos(b) * side[:, None] + np.sin(b) * other[:, None])
    return grid(points, tone=tone[:, None])


def turned(outline: Any, axis: int = 2, around: int = 96, tone: Any = 0.5) -> Body:
    """Surface of revolution about an axis (1: y, 2: z) of (radius, height) pairs; u round it, v along it."""
    radius, height = np.asarray(outline, dtype=float).T[:, :, None]
    angle = np.linspace(0, 2 * np.pi, around + 1)
    across, aside, along = radius * np.cos(angle), radius * np.sin(angle), height + 0 * angle
    points = np.stack([across, along, -aside] if axis == 1 else [across, aside, along], axis=2)
    way = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(np.asarray(outline, dtype=float), axis=0).T))])
    v, u = np.meshgrid(way / way[-1], angle / (2 * np.pi), indexing="ij")
    return grid(points, uv=np.stack([u, v], axis=2), tone=tone)


def seen_from_front(body: Body, radius: float) -> Body:
    """The same body with a picture of 2 radius × 2 radius laid on along z, its middle on the z axis."""
    return body._replace(uv=body.vertices[:, :2] / (2 * radius) + 0.5)


def mesh(name: str, body: Body, bsdf: dict[str, Any], pose: Any) -> mi.Mesh:
    """The body as a smooth Mitsuba mesh with its own id, placed; ``vertex_tone`` carries its tones."""
    matrix = np.array(pose.matrix, dtype=float)
    placed = body.vertices @ matrix[:3, :3].T + matrix[:3, 3]
    tones = {"vertex_tone": body.tone}
    return make_mesh(name, placed, faces=body.triangles, bsdf=bsdf, uv=body.uv, smooth=True, attributes=tones)


def matte(reflectance: np.ndarray | float) -> dict[str, Any]:
    """Diffuse on both sides; a picture's first row is the top of the surface."""
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": _reflectance(reflectance)}}


def satin(reflectance: np.ndarray | float, roughness: float) -> dict[str, Any]:
    """Varnish, print or plastic: a rough coat over a diffuse ground."""
    ground = _reflectance(reflectance)
    coat = {"type": "roughplastic", "diffuse_reflectance": ground, "alpha": roughness, "int_ior": 1.5}
    return {"type": "twosided", "bsdf": coat}


def lacquer(roughness: float) -> dict[str, Any]:
    """Paint on wire, in the tones of the vertices, which a roughplastic does not take."""
    tones = {"type": "mesh_attribute", "name": "vertex_tone"}
    coat = {"type": "principled", "base_color": tones, "roughness": roughness, "specular": 0.5}
    return {"type": "twosided", "bsdf": coat}


def _reflectance(reflectance: np.ndarray | float) -> Any:
    if isinstance(reflectance, float):
        return reflectance
    rows = np.ascontiguousarray(reflectance[::-1], dtype=np.float32)  # a bitmap begins at v = 0
    return {"type": "bitmap", "bitmap": mi.Bitmap(rows), "raw": True, "wrap_mode": "clamp"}


def sheet(pose: Any, width: float, height: float, bsdf: dict[str, Any]) -> dict[str, Any]:
    """Rectangle in the plane of x and y of its pose, facing +z."""
    size = mi.ScalarTransform4f().scale([width / 2, height / 2, 1])
    return {"type": "rectangle", "to_world": pose @ size, "bsdf": bsdf}


def box(pose: Any, size: Vector, bsdf: dict[str, Any]) -> dict[str, Any]:
    """Box of this size (m) about the pose's origin; each face wears the whole picture."""
    half = mi.ScalarTransform4f().scale([side / 2 for side in size])
    return {"type": "cube", "to_world": pose @ half, "bsdf": bsdf}


def panel(origin: Any, towards: Any, size: tuple[float, float], radiance: float) -> dict[str, Any]:
    """A lamp: a rectangle of even radiance (W m^-2 sr^-1) that faces a point."""
    pose = mi.ScalarTransform4f().look_at(origin=list(origin), target=list(towards), up=[0, 1, 0])
    return {
        **sheet(pose, *size, {"type": "diffuse", "reflectance": 0.0}),
        "emitter": {"type": "area", "radiance": radiance},
    }
