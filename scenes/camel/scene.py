"""Still life: a carved camel on a kilim runner; cup and fruit behind, books and wallpaper far, toys near.

World frame: metres, x right, y up, z towards the lens; table top at y = 0, camel near the origin.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import patterns
import sculpture

from saf_gen.render.meshes import make_mesh

M_PER_MM = 1e-3
CAMEL_TEXEL_MM = 0.12  # the lens resolves 0.5 mm here
WALL_Z, TABLE_NEAR_Z, TABLE_WIDTH = -0.62, 0.30, 0.80
BOOKS_LEFT, BOOKS_Z = -0.19, -0.36

LAMP_RADIANCE, WINDOW_RADIANCE = 110.0, 7.0  # W m^-2 sr^-1
LAMP_SIZE, LAMP_ORIGIN = 0.25, (-0.65, 0.52, 0.28)
WINDOW_SIZE, WINDOW_ORIGIN = 1.1, (0.95, 0.75, 0.55)

# Outlines turned about the y axis: (radius, height) in mm, from the foot up outside and down inside.
CUP = [
    (0, 0.5), (20, 0), (22, 2), (25, 10), (29, 30), (31, 50), (32.5, 68), (32, 69.5), (30.5, 69), (29, 50),
    (27, 30), (22, 8), (0, 6),
]  # fmt: skip
BOWL = [
    (0, 0.5), (24, 0), (26, 2), (30, 7), (44, 18), (53, 30), (58, 42), (57.5, 43.5), (56, 43), (51, 31),
    (42, 20), (28, 10), (0, 8),
]  # fmt: skip
PAWN = [
    (0, 0), (11.5, 0), (12, 2), (11.5, 5), (9.5, 7), (9, 9.5), (6, 15), (4.6, 22), (4.3, 28), (7.4, 29.5),
    (7.6, 31), (4.8, 32.5), (4.4, 34), (6.2, 36), (7.2, 39), (7.0, 42.5), (5.2, 46), (2.4, 47.9), (0, 48.3),
]  # fmt: skip
# Books from left to right: thickness, height, depth in mm, cloth, ink.
BOOKS = [
    (34, 190, 120, 0.06, 0.55), (22, 165, 110, 0.42, 0.06), (28, 205, 120, 0.14, 0.65),
    (18, 150, 105, 0.55, 0.10), (30, 180, 120, 0.08, 0.50),
]  # fmt: skip


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    seed = 100 * params["materials"]
    return {
        "type": "scene",
        **_lights(),
        **_room(seed),
        **_figurine(params["yaw_deg"], params["nearer_m"], seed),
        **_tableware(1 if params["cup"] == "left" else -1, seed),
        **_books(BOOKS_LEFT + params["books_m"], seed),
    }


def _lights() -> dict[str, Any]:
    return {
        "lamp": _panel(LAMP_ORIGIN, LAMP_SIZE, LAMP_RADIANCE),
        "window": _panel(WINDOW_ORIGIN, WINDOW_SIZE, WINDOW_RADIANCE),
    }


def _room(seed: int) -> dict[str, Any]:
    depth = TABLE_NEAR_Z - WALL_Z
    table = patterns.planks((1536, 1024), boards=12, mean=0.24, seed=seed + 3)
    runner = patterns.kilim((600, 1800), motifs=15, seed=seed + 5)
    wall = patterns.wallpaper((512, 1024), stripes=24, seed=seed + 7)
    flat = mi.ScalarTransform4f().rotate([1, 0, 0], -90)
    middle = (TABLE_NEAR_Z + WALL_Z) / 2
    return {
        "table": _sheet([0, 0, middle], flat, TABLE_WIDTH, depth, _matte(table)),
        "runner": _sheet([0, 0.0006, 0.0], flat, 0.36, 0.12, _matte(runner)),
        "wall": _sheet([0, 0.2, WALL_Z], mi.ScalarTransform4f(), 0.8, 0.4, _matte(wall)),
    }


def _figurine(yaw_deg: float, nearer_m: float, seed: int) -> dict[str, Any]:
    vertices, triangles = sculpture.camel()
    corner = np.array([sculpture.LENGTH_MM[0], sculpture.HEIGHT_MM[0]])
    extent = np.array([np.ptp(sculpture.LENGTH_MM), np.ptp(sculpture.HEIGHT_MM)])
    columns, rows = (extent / CAMEL_TEXEL_MM).astype(int)
    skin = _painted(patterns.wood((rows, columns), rings=9, mean=0.36, contrast=0.75, seed=seed + 11), seed)
    uv = (vertices[:, :2] - corner) / extent
    angle = np.radians(yaw_deg)
    x, y, z = vertices.T * M_PER_MM
    turned = np.column_stack([x * np.cos(angle) + z * np.sin(angle), y, z * np.cos(angle) - x * np.sin(angle)])
    feet = np.array([-0.008, 0.0006, nearer_m])
    return {"camel": _mesh("camel", turned + feet, triangles, uv, _matte(skin))}


def _painted(grain: np.ndarray, seed: int) -> np.ndarray:
    """Saddle cloth between the humps, bridle and eye, painted on the side view of the wood."""
    row, column = np.indices(grain.shape, dtype=np.float32)
    x = sculpture.LENGTH_MM[0] + (column + 0.5) * CAMEL_TEXEL_MM
    y = sculpture.HEIGHT_MM[1] - (row + 0.5) * CAMEL_TEXEL_MM
    across, down = np.abs(x + 0.5) / 10.5, (70 - y) / 32  # 0..1 over the saddle cloth
    cloth = (across < 1) & (down > 0) & (down < 1)
    diamonds = np.floor(np.abs((x + 0.5) / 3.5 % 2 - 1) * 2 + np.abs(y / 3.5 % 2 - 1) * 2) % 2
    border = (across > 0.82) | (down > 0.92)
    stitches = border & (np.floor((x + y) / 1.2) % 2 == 0)
    saddle = np.where(border, 0.75, 0.10 + 0.45 * diamonds)
    saddle[stitches] = 0.08
    weave = 1 + 0.25 * patterns.noise(grain.shape, (grain.shape[0] // 4, grain.shape[1] // 4), seed=seed + 13)
    painted = np.where(cloth, saddle * weave, grain)
    strap = (np.abs(x - 66) < 0.8) | (np.abs(y - 82.5 - 0.25 * (x - 60)) < 0.7)
    painted[strap & (x > 56) & (y > 72)] = 0.08
    painted[np.hypot(x - 59.8, y - 86.2) < 1.4] = 0.03
    return painted.astype(np.float32)


def _tableware(side: int, seed: int) -> dict[str, Any]:
    """`side`: 1 with the cup on the left, -1 all mirrored."""
    cup = _satin(patterns.glaze((384, 768), ground=0.72, ink=0.12, waves=9, seed=seed + 17))
    bowl = _satin(patterns.glaze((256, 1024), ground=0.18, ink=0.60, waves=16, seed=seed + 19))
    pawn = _satin(patterns.wood((512, 512), rings=7, mean=0.16, contrast=0.6, seed=seed + 23))
    ball = _matte(patterns.wood((512, 512), rings=9, mean=0.28, contrast=0.7, seed=seed + 29))
    fruit = _satin(patterns.peel((384, 768), seed=seed + 31))
    scene = {
        "cup": _turned("cup", CUP, (-0.105 * side, 0, -0.09), cup),
        "bowl": _turned("bowl", BOWL, (0.100 * side, 0, -0.21), bowl),
        "pawn": _turned("pawn", PAWN, (0.064 * side, 0, 0.165), pawn),
        "ball": _ball((-0.060 * side, 0.017, 0.130), 0.017, ball),
    }
    heap = [(0.076, 0.050, -0.195, 0.029), (0.128, 0.048, -0.200, 0.028), (0.100, 0.050, -0.240, 0.030)]
    for number, (x, y, z, radius) in enumerate(heap):
        scene[f"orange_{number}"] = _ball((x * side, y, z), radius, fruit)
    return scene


def _books(left: float, seed: int) -> dict[str, Any]:
    scene = {}
    for number, (*size_mm, ground, ink) in enumerate(BOOKS):
        thick, high, deep = (side * M_PER_MM for side in size_mm)
        front = BOOKS_Z + 0.004 * (number % 3)
        pose = mi.ScalarTransform4f().translate([left + thick / 2, high / 2, front - deep / 2])
        cover = patterns.spine((640, 128), ground=ground, ink=ink, seed=seed + 37 + number)
        scene[f"book_{number}"] = {
            "type": "cube",
            "to_world": pose @ mi.ScalarTransform4f().scale([thick / 2, high / 2, deep / 2]),
            "bsdf": _matte(cover),
        }
        left += thick + 0.0012
    return scene


def _panel(origin: tuple[float, float, float], size: float, radiance: float) -> dict[str, Any]:
    """A square lamp facing the camel."""
    pose = mi.ScalarTransform4f().look_at(origin=list(origin), target=[0, 0.04, 0], up=[0, 1, 0])
    return {
        "type": "rectangle",
        "to_world": pose @ mi.ScalarTransform4f().scale(size / 2),
        "bsdf": {"type": "diffuse", "reflectance": 0.0},
        "emitter": {"type": "area", "radiance": radiance},
    }


def _sheet(centre: list[float], turn: Any, width: float, height: float, bsdf: dict[str, Any]) -> dict[str, Any]:
    size = mi.ScalarTransform4f().scale([width / 2, height / 2, 1])
    return {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate(centre) @ turn @ size, "bsdf": bsdf}


def _ball(centre: tuple[float, float, float], radius: float, bsdf: dict[str, Any]) -> dict[str, Any]:
    tilt = mi.ScalarTransform4f().translate(list(centre)).rotate([1, 0, 0], 65)
    return {"type": "sphere", "radius": radius, "to_world": tilt, "bsdf": bsdf}


def _turned(
    name: str, outline_mm: list[tuple[float, float]], foot: tuple[float, float, float], bsdf: dict[str, Any]
) -> mi.Mesh:
    """Surface of revolution of an outline about the vertical through `foot`."""
    steps, around = 6, 96
    knots = np.array(outline_mm) * M_PER_MM
    at = np.linspace(0, len(knots) - 1, steps * (len(knots) - 1) + 1)
    radius, height = (_catmull_rom(knots[:, k], at) for k in (0, 1))
    angle = np.linspace(0, 2 * np.pi, around + 1)
    ring = np.stack([np.cos(angle), np.zeros_like(angle), -np.sin(angle)], axis=1)
    vertices = np.maximum(radius, 0)[:, None, None] * ring + height[:, None, None] * [0, 1, 0]
    v, u = np.meshgrid(height / height.max(), angle / (2 * np.pi), indexing="ij")
    first = (np.arange(len(at) - 1)[:, None] * (around + 1) + np.arange(around)).ravel()
    above = first + around + 1
    halves = [(first, first + 1, above + 1), (first, above + 1, above)]
    triangles = np.concatenate([np.stack(half, axis=1) for half in halves])
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    return _mesh(name, vertices.reshape(-1, 3) + foot, triangles, uv, bsdf)


def _catmull_rom(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Smooth curve through values at 0, 1, 2, ..., with soft tangents, so that it hardly overshoots."""
    first = np.minimum(at.astype(int), len(values) - 2)
    t = at - first
    slope = 0.5 * np.gradient(values)
    a, b, ta, tb = values[first], values[first + 1], slope[first], slope[first + 1]
    return a + t * (ta + t * (3 * (b - a) - 2 * ta - tb + t * (2 * (a - b) + ta + tb)))


def _mesh(name: str, vertices: np.ndarray, triangles: np.ndarray, uv: np.ndarray, bsdf: dict[str, Any]) -> mi.Mesh:
    """Triangle mesh in metres with smooth normals; its id is its name."""
    return make_mesh(name, vertices, faces=triangles, bsdf=bsdf, uv=uv, smooth=True)


def _texture(pattern: np.ndarray) -> dict[str, Any]:
    bottom_up = np.ascontiguousarray(pattern[::-1])  # a bitmap's first row lies at v = 0
    return {"type": "bitmap", "bitmap": mi.Bitmap(bottom_up), "raw": True}


def _matte(pattern: np.ndarray) -> dict[str, Any]:
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": _texture(pattern)}}


def _satin(pattern: np.ndarray) -> dict[str, Any]:
    """Varnish or glaze: a broad, soft highlight over the pattern."""
    coat = {"type": "roughplastic", "diffuse_reflectance": _texture(pattern), "alpha": 0.25}
    return {"type": "twosided", "bsdf": coat}
