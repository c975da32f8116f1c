"""The street without lights and traffic: wet asphalt, pavements, houses; metres, x right, y up, -z away.

The camera stands over the right pavement and looks along the street, which is closed by a house at z = END_Z.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from meshes import Body, box, grid, joined, quad, texture, tube, turned

RIGHT_WALL, RIGHT_KERB, LEFT_KERB, LEFT_WALL = 1.0, -0.6, -6.0, -7.4
END_Z, NEAR_Z, KERB = -118.0, 26.0, 0.12
TEXEL_M = (0.08, 0.02)  # along and across the street: seen at two degrees, it is short along


def noise(shape: tuple[int, int], cells: tuple[int, int], random: np.random.Generator) -> np.ndarray:
    """Smooth value noise in -1..1 over a lattice of `cells` down and across."""
    field = random.uniform(-1, 1, (cells[0] + 2, cells[1] + 2)).astype(np.float32)
    for axis in (0, 1):
        at = np.arange(shape[axis], dtype=np.float32) * (cells[axis] / shape[axis])
        first = at.astype(np.int64)
        part = at - first
        part = part * part * (3 - 2 * part)
        part = part[:, None] if axis == 0 else part[None, :]
        low = np.take(field, first, axis=axis)
        field = low + part * (np.take(field, first + 1, axis=axis) - low)
    return field


def road() -> Body:
    """The carriageway; its picture's top row lies at the far end."""
    points = [(LEFT_KERB, 0, NEAR_Z), (RIGHT_KERB, 0, NEAR_Z), (RIGHT_KERB, 0, END_Z), (LEFT_KERB, 0, END_Z)]
    return quad(*points, uv=[(0, 0), (1, 0), (1, 1), (0, 1)])


def wet_asphalt(wet: float, random: np.random.Generator) -> dict[str, Any]:
    """Damp asphalt with puddles: ``wet``, 0..1, is about the share that water covers.

    Both are dark ground under water; damp asphalt scatters widely, a puddle like ruffled water.
    """
    shape = (int((NEAR_Z - END_Z) / TEXEL_M[0]), int((RIGHT_KERB - LEFT_KERB) / TEXEL_M[1]))
    ground = 0.055 * (1 + 0.35 * random.standard_normal(shape, dtype=np.float32))
    ground *= 1 + 0.25 * noise(shape, (60, 8), random)
    x = np.arange(shape[1]) * TEXEL_M[1] + LEFT_KERB
    z = np.arange(shape[0]) * TEXEL_M[0]
    dash = (np.abs(x - 0.5 * (LEFT_KERB + RIGHT_KERB)) < 0.07)[None, :] & (np.mod(z, 6.0) < 2.8)[:, None]
    bay = (np.abs(x - LEFT_KERB - 2.0) < 0.05)[None, :] & np.ones_like(dash)
    worn = noise(shape, (300, 30), random) < 0.4
    ground[(dash | bay) & worn] = 0.38
    # Water lies in wheel ruts, at the kerbs, and in hollows.
    hollow = noise(shape, (34, 5), random) + 0.55 * noise(shape, (90, 14), random)
    rut = 0.45 * np.cos(2 * np.pi * (x - LEFT_KERB) / 1.35)[None, :] ** 8
    gutter = 1.1 * np.exp(-np.minimum(x - LEFT_KERB, RIGHT_KERB - x) / 0.22)[None, :]
    level = hollow + rut + gutter
    cover = np.clip((level - np.quantile(level, 1 - wet)) / 0.25 + 0.5, 0, 1)
    damp = _coat(texture(np.clip(ground, 0.015, 0.5)), 0.20, 1.33)
    pool = _coat(texture(np.clip(0.55 * ground, 0.01, 0.3)), 0.035, 1.33)
    return {"type": "blendbsdf", "weight": texture(cover), "damp": damp, "pool": pool}


def _coat(under: Any, alpha: float, ior: float) -> dict[str, Any]:
    return {"type": "roughplastic", "diffuse_reflectance": under, "alpha": alpha, "int_ior": ior}


def pavements() -> Body:
    """Both pavements, with metres as coordinates."""
    made = []
    for a, b in ((RIGHT_KERB, RIGHT_WALL + 0.3), (LEFT_WALL - 0.3, LEFT_KERB)):
        made.append(quad((a, KERB, NEAR_Z), (b, KERB, NEAR_Z), (b, KERB, END_Z), (a, KERB, END_Z)))
    return joined(made)


def wet_slabs(random: np.random.Generator) -> dict[str, Any]:
    """8 m × 8 m of wet concrete slabs."""
    n, texel = 320, 0.025
    line = (np.arange(n) * texel / 0.4).astype(int)
    tone = random.uniform(0.75, 1.2, (21, 21))
    ground = 0.13 * tone[line[:, None], line[None, :]] * (1 + 0.12 * random.standard_normal((n, n)))
    joint = np.mod(np.arange(n) * texel, 0.4) < texel
    ground[joint] *= 0.4
    ground[:, joint] *= 0.4
    return {"type": "twosided", "bsdf": _coat(texture(np.clip(ground, 0.02, 0.4), (8.0, 8.0)), 0.22, 1.33)}


def fixtures(random: np.random.Generator) -> list[Body]:
    """Kerbs, bollards, bins, drains, shop fronts' plinths and pilasters, awnings, sills of dark windows."""
    made: list[Body] = []
    for x, side in ((RIGHT_KERB, 1), (LEFT_KERB, -1)):
        for z in np.arange(NEAR_Z, END_Z, -1.0):
            tone = 0.22 * float(random.uniform(0.7, 1.2))
            a, b = sorted((x, x + side * 0.15))
            made.append(box((a, 0, z - 0.985), (b, KERB + 0.012, z), tone))
    for z in np.arange(-16.0, END_Z, -4.5):
        outline = [(0.055, 0), (0.055, 0.8), (0.03, 0.86), (0, 0.88)]
        made.append(turned(outline, (RIGHT_KERB + 0.35, KERB, z), tone=0.06))
    for x, face in ((RIGHT_WALL, -1), (LEFT_WALL, 1)):
        for z in np.arange(-8.0, END_Z, -6.0):
            made.append(box((x - 0.08, 0, z - 0.25), (x + 0.08, 3.3, z + 0.25), float(random.uniform(0.08, 0.4))))
            made.append(box((x - 0.12, 3.25, z - 6.0), (x + 0.12, 3.45, z), float(random.uniform(0.15, 0.4))))
            if random.random() < 0.4:
                tone = float(random.uniform(0.08, 0.35))
                near, far = z - 1.0, z - 5.0
                made.append(
                    quad(
                        (x + face * 1.1, 2.55, near),
                        (x + face * 1.1, 2.55, far),
                        (x, 3.2, far),
                        (x, 3.2, near),
                        tone=tone,
                    )
                )
                made.append(
                    quad(
                        (x + face * 1.1, 2.32, near),
                        (x + face * 1.1, 2.32, far),
                        (x + face * 1.1, 2.55, far),
                        (x + face * 1.1, 2.55, near),
                        tone=0.5 * tone,
                    )
                )
            for storey in (4.2, 7.2):
                for at in (z - 1.7, z - 4.2):
                    made.append(box((x - 0.05, storey, at - 0.55), (x + 0.03 * face, storey + 1.7, at + 0.55), 0.03))
                    made.append(box((x - 0.1, storey - 0.1, at - 0.65), (x + 0.12 * face, storey, at + 0.65), 0.3))
    return made


def walls() -> list[Body]:
    """The fronts of both rows, and the house across the end, with metres as coordinates."""
    top = 10.5
    right = quad((RIGHT_WALL, 0, NEAR_Z), (RIGHT_WALL, 0, END_Z), (RIGHT_WALL, top, END_Z), (RIGHT_WALL, top, NEAR_Z))
    left = quad((LEFT_WALL, 0, END_Z), (LEFT_WALL, 0, NEAR_Z), (LEFT_WALL, top, NEAR_Z), (LEFT_WALL, top, END_Z))
    return [right, left]


def plaster(random: np.random.Generator, tone: float) -> dict[str, Any]:
    """8 m × 8 m of wall with streaks and grain."""
    shape = (256, 256)
    wall = tone * (1 + 0.15 * noise(shape, (3, 90), random) + 0.12 * noise(shape, (6, 6), random))
    wall *= 1 + 0.06 * random.standard_normal(shape, dtype=np.float32)
    picture = np.clip(wall, 0.03, 0.8)
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": texture(picture, (8.0, 8.0))}}


def lamp_posts(places: list[tuple[float, float]], high: float) -> list[Body]:
    """Cast-iron posts with a collar, for globes at this height."""
    made = []
    for x, z in places:
        outline = [
            (0.12, 0),
            (0.12, 0.25),
            (0.07, 0.4),
            (0.055, 1.2),
            (0.07, 1.25),
            (0.045, 1.35),
            (0.035, high - 0.3),
            (0.10, high - 0.2),
            (0.06, high - 0.14),
        ]
        made.append(turned(outline, (x, KERB, z), tone=0.05))
        made.append(turned([(0.10, high + 0.14), (0.05, high + 0.22), (0, high + 0.25)], (x, KERB, z), tone=0.05))
    return made


def planter(middle: np.ndarray, random: np.random.Generator) -> list[Body]:
    """Stems with leaves close to the camera: a window box that reaches into the picture."""
    made = []
    for _ in range(22):
        foot = middle + random.normal(0, 1, 3) * [0.075, 0.015, 0.06]
        way = random.normal(0, 0.35, 3) + np.array([0.1, 1.0, 0])
        stem = foot + np.linspace(0, random.uniform(0.05, 0.12), 5)[:, None] * way
        made.append(tube(stem, 0.0014, around=6, tone=0.10))
        made += [_leaf(stem[k], random) for k in (1, 2, 3, 4, 4)]
    return made


def _leaf(foot: np.ndarray, random: np.random.Generator) -> Body:
    """An oval leaf, hanging over and folded a little along its rib."""
    along = random.normal(0, 1, 3) * [1, 0.5, 1] + np.array([0, 0.25, 0])
    along *= random.uniform(0.016, 0.030) / np.linalg.norm(along)
    side = np.cross(along, random.normal(0, 0.4, 3) + np.array([0, 1.0, 0]))
    side /= np.linalg.norm(side)
    t = np.linspace(0, 1, 8)[:, None, None]
    half = 0.30 * float(np.linalg.norm(along)) * np.sin(np.pi * t**0.8)
    across = np.array([-1.0, 0.0, 1.0])[None, :, None]
    down = np.array([0, -1.0, 0]) * (0.25 * np.linalg.norm(along) * t**2 + 0.3 * half * np.abs(across))
    return grid(foot + t * along + half * across * side + down, tone=float(random.uniform(0.06, 0.20)))
