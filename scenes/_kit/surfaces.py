"""What bodies become in Mitsuba: meshes, pictures as textures, matt and glossy surfaces, lamps; and smooth noise."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.render.meshes import make_mesh

Shape = tuple[int, int]


def noise(shape: Shape, cells: tuple[float, float], random: np.random.Generator) -> np.ndarray:
    """Smooth value noise in -1..1, float32, with so many lattice cells down and across."""
    lattice = random.uniform(-1, 1, [int(n) + 2 for n in cells]).astype(np.float32)
    for axis in (0, 1):
        at = np.arange(shape[axis], dtype=np.float32) * np.float32(cells[axis] / shape[axis])
        first = at.astype(np.int64)
        part = at - first
        part *= part * (3 - 2 * part)
        part = part[:, None] if axis == 0 else part
        here = np.take(lattice, first, axis=axis)
        lattice = here + part * (np.take(lattice, first + 1, axis=axis) - here)
    return lattice


def cloudy(shape: Shape, cells: float, octaves: int, random: np.random.Generator) -> np.ndarray:
    """Octaves of noise, each twice as fine and 0.6 times as strong, about -1..1; ``cells`` across the first."""
    high = max(cells * shape[0] / shape[1], 1.0)
    layers = (0.6**k * noise(shape, (high * 2**k, cells * 2**k), random) for k in range(octaves))
    return sum(layers, np.zeros(shape, dtype=np.float32))


def mesh(name: str, body: Any, bsdf: Any, *, smooth: bool = True) -> mi.Mesh:
    """A body (vertices, triangles, uv, tone) as a Mitsuba mesh with its own id; ``vertex_tone`` carries its tones.

    bsdf : a dictionary, or loaded, which several meshes may share.
    """
    return make_mesh(
        name,
        body.vertices,
        faces=body.triangles,
        bsdf=bsdf,
        uv=body.uv,
        smooth=smooth,
        attributes={"vertex_tone": body.tone},
        **({} if smooth else {"face_normals": True}),
    )


def texture(picture: np.ndarray, *, repeat: tuple[float, float] | None = None) -> dict[str, Any]:
    """A picture of reflectances, row 0 on top; ``repeat``: so many times across and up, else its rim goes on."""
    rows = np.ascontiguousarray(picture[::-1], dtype=np.float32)  # a bitmap begins at v = 0
    made = {"type": "bitmap", "bitmap": mi.Bitmap(rows), "raw": True}
    if repeat is None:
        return made | {"wrap_mode": "clamp"}
    return made | {"to_uv": mi.ScalarTransform4f().scale([*repeat, 1])}


def tones() -> dict[str, Any]:
    """The tones of a mesh's vertices as a texture, which diffuse and principled surfaces take."""
    return {"type": "mesh_attribute", "name": "vertex_tone"}


def matte(reflectance: Any) -> dict[str, Any]:
    """Diffuse on both sides: a number, or a texture."""
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": reflectance}}


def glossy(reflectance: Any, alpha: float, *, ior: float = 1.5) -> dict[str, Any]:
    """A rough coat over a diffuse ground, on both sides: varnish, plastic, wet or greasy things."""
    coat = {"type": "roughplastic", "diffuse_reflectance": reflectance, "alpha": alpha, "int_ior": ior}
    return {"type": "twosided", "bsdf": coat}


def metal(eta: float, k: float, alpha: Any) -> dict[str, Any]:
    """A rough metal by its index and absorption, on both sides; ``alpha`` may be a texture."""
    rough = {"type": "roughconductor", "distribution": "ggx", "eta": eta, "k": k, "alpha": alpha}
    return {"type": "twosided", "bsdf": rough}


def panel(origin: Any, towards: Any, size: tuple[float, float], radiance: float) -> dict[str, Any]:
    """A lamp: a rectangle of even radiance (W m^-2 sr^-1) that faces a point."""
    pose = mi.ScalarTransform4f().look_at(origin=list(origin), target=list(towards), up=[0, 1, 0.001])
    return {
        "type": "rectangle",
        "to_world": pose @ mi.ScalarTransform4f().scale([size[0] / 2, size[1] / 2, 1]),
        "bsdf": {"type": "diffuse", "reflectance": 0.0},
        "emitter": {"type": "area", "radiance": radiance},
    }
