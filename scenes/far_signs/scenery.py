"""What stands before and behind the sign: a twig, a clock, a tree, a brick front with windows and bills.

World frame: metres, x right, y up, the lens looks along -z.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import prints
from solids import Body, box, grid, joined, placed, rounded, tube, turned, turning
from surfaces import cloudy, glossy, matte, mesh, noise, texture, tones

CLOCK, CLOCK_R = np.array([-0.86, 2.92, -44.0]), 0.33
WALL_Z, TREE_Z, TWIG_Z = -66.0, -55.0, -21.0
COURSE, BRICK = 0.075, 0.24


def coated(roughness: float) -> dict[str, Any]:
    """Paint, leaves and dull metal: the tones of a mesh below a coat of this roughness, on both sides."""
    coat = {"type": "principled", "base_color": tones(), "roughness": roughness, "specular": 0.5}
    return {"type": "twosided", "bsdf": coat}


def clock(time_min: float) -> dict[str, Any]:
    """A clock in a drum, which a bracket with a scroll holds off its post."""
    a = np.linspace(0, 2 * np.pi, 97)
    ring = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    dial = grid(np.stack([0 * ring, 0.5 * ring, ring]), uv=np.stack([0.5 + k * ring[:, :2] for k in (0, 0.25, 0.5)]))
    drum = turned([(0.98, -0.02), (1.00, 0.05), (1.05, 0.07), (1.09, 0.04), (1.10, -0.02), (1.10, -0.42)], tone=0.05)
    drum = placed(drum, turn=turning([1, 0, 0], 90))
    x = -0.46  # of the post
    pole = [(x, -CLOCK[1], 0), (x, 0.40, 0)]
    parts = [
        placed(drum, scale=CLOCK_R),
        tube(pole, 0.055, around=24, tone=0.055),
        placed(turned([(0.075, 0), (0.085, 0.02), (0.05, 0.05), (0.07, 0.10), (0.0, 0.19)], tone=0.055), (x, 0.38, 0)),
        tube([(x, 0.28, 0), (0.05, 0.42, -0.06), (0.0, 0.35, -0.06)], 0.02, tone=0.05),
        tube(
            rounded([(x, -0.55, 0), (x + 0.16, -0.50, -0.06), (x + 0.30, -0.36, -0.06), (0.0, -0.34, -0.06)]),
            0.018,
            tone=0.05,
        ),
        *(
            placed(turned([(0.057, 0), (0.075, 0.012), (0.075, 0.03), (0.057, 0.045)], tone=0.05), (x, y, 0))
            for y in (-0.6, -0.1)
        ),
    ]
    face = placed(dial, CLOCK, scale=CLOCK_R)
    return {
        "clock": mesh("clock", face, glossy(texture(prints.clock(time_min)), 0.12), smooth=False),
        "clock_case": mesh("clock_case", placed(joined(parts), CLOCK), coated(0.45)),
    }


def leaves(places: np.ndarray, size_m: float, random: np.random.Generator) -> Body:
    """Bent, pointed leaves of eight triangles at places (n, 3), turned anyhow but mostly upwards."""
    count = len(places)
    along = np.linspace(0, 1, 6)
    half = 0.32 * np.sin(np.pi * along**0.8)
    blade = np.stack(
        [
            np.stack([side * half, along - 0.5, 0.10 * np.abs(side) - 0.28 * (along - 0.4) ** 2], axis=1)
            for side in (-1.0, 0.0, 1.0)
        ],
        axis=1,
    )
    flat = blade.reshape(-1, 3)  # (18, 3): rows along the leaf, three across
    way = random.normal(size=(count, 3)) + np.array([0, -0.5, 0.3])
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    up = random.normal(size=(count, 3)) * 0.6 + np.array([0, 1.0, 0.5])
    side = np.cross(way, up)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    frame = np.stack([side, way, np.cross(side, way)], axis=1)  # (n, 3, 3), rows are axes
    sizes = size_m * random.uniform(0.7, 1.3, (count, 1, 1))
    points = (flat[None] * sizes) @ frame + places[:, None, :]
    one = grid(blade)
    triangles = (one.triangles[None] + len(flat) * np.arange(count)[:, None, None]).reshape(-1, 3)
    tone = np.repeat(random.uniform(0.07, 0.21, count), len(flat))
    return Body(points.reshape(-1, 3), triangles, np.tile(one.uv, (count, 1)), tone)


def tree(side: int, random: np.random.Generator) -> dict[str, Any]:
    """The crown of a tree beside the sign: boughs, and clumps of leaves of 7 cm with gaps between."""
    middle = np.array([side * 1.75, 3.1, TREE_Z])
    boughs, clumps = [], []
    for _ in range(16):
        out = random.normal(size=3) * np.array([0.55, 0.65, 0.7])
        bend = middle + 0.5 * out + np.array([0.15 * side, -0.15, 0])
        boughs.append(
            tube(
                rounded([middle + np.array([side * 0.5, -1.6, 0]), bend, middle + out]),
                np.linspace(0.05, 0.008, 17),
                around=8,
                tone=0.09,
            )
        )
        clumps.append(middle + out)
    places = np.concatenate([clump + random.normal(size=(290, 3)) * np.array([0.36, 0.30, 0.40]) for clump in clumps])
    leaf = leaves(places, 0.075, random)
    return {"boughs": mesh("boughs", joined(boughs), matte(tones())), "leaves": mesh("leaves", leaf, coated(0.59))}


def twig(side: int, random: np.random.Generator) -> dict[str, Any]:
    """A twig of a hedge nearer than the sign, from below into a corner of the picture."""
    stems, places = [], []
    for k in range(7):
        foot = np.array([side * (0.30 + 0.055 * k), 2.02, TWIG_Z + random.uniform(-0.1, 0.1)])
        tip = foot + np.array([side * random.uniform(-0.10, 0.12), random.uniform(0.26, 0.32 + 0.05 * k), 0.0])
        path = rounded([foot, (foot + tip) / 2 + random.normal(size=3) * 0.02, tip], steps=6)
        stems.append(tube(path, np.linspace(0.004, 0.0012, len(path)), around=8, tone=0.12))
        places.append(path[2:] + random.normal(size=(len(path) - 2, 3)) * 0.016)
        places.append(path[2:] + random.normal(size=(len(path) - 2, 3)) * 0.020)
    leaf = leaves(np.concatenate(places), 0.042, random)
    return {"stems": mesh("stems", joined(stems), matte(tones())), "hedge": mesh("hedge", leaf, coated(0.55))}


def front(random: np.random.Generator) -> dict[str, Any]:
    """The wall of the station building: brick, windows with stone about them, a fascia, bills, a pipe."""
    z = WALL_Z
    ground = grid([[(-14, 0, -12), (14, 0, -12)], [(-14, 0, z), (14, 0, z)]])
    wall = grid([[(-6, 0, z), (6, 0, z)], [(-6, 7.2, z), (6, 7.2, z)]])
    shift = random.uniform(-0.5, 0.5)
    stone, wood, iron, panes = [], [], [], []
    for x in (-1.65 + shift, 0.15 + shift, 1.95 + shift):
        low, high = 1.55, 2.92
        stone.append(box((x - 0.58, low - 0.14, z), (x + 0.58, low, z + 0.13), tone=0.42))
        stone.append(box((x - 0.56, high, z), (x + 0.56, high + 0.24, z + 0.04), tone=0.44))
        stone.append(box((x - 0.09, high - 0.01, z), (x + 0.09, high + 0.27, z + 0.08), tone=0.46))
        panes.append(
            grid(
                [
                    [(x - 0.46, low, z + 0.012), (x + 0.46, low, z + 0.012)],
                    [(x - 0.46, high, z + 0.012), (x + 0.46, high, z + 0.012)],
                ]
            )
        )
        for across in (-0.445, -0.02, 0.40):
            wood.append(box((x + across, low, z + 0.01), (x + across + 0.045, high, z + 0.05), tone=0.62))
        for up in (low, low + 0.66, low + 0.98, high - 0.05):
            wood.append(box((x - 0.46, up, z + 0.01), (x + 0.46, up + 0.05, z + 0.055), tone=0.62))
    wood.append(box((-1.75 + shift, 3.27, z + 0.01), (1.75 + shift, 3.31, z + 0.16), tone=0.3))
    iron.append(tube([(-0.74 + shift, 0, z + 0.07), (-0.74 + shift, 7, z + 0.07)], 0.05, around=16, tone=0.10))
    for y in (0.9, 2.1, 3.2, 4.4):
        iron.append(box((-0.82 + shift, y, z), (-0.66 + shift, y + 0.05, z + 0.10), tone=0.08))
    board = grid(
        [
            [(-1.7 + shift, 3.32, z + 0.09), (1.7 + shift, 3.32, z + 0.09)],
            [(-1.7 + shift, 3.78, z + 0.09), (1.7 + shift, 3.78, z + 0.09)],
        ]
    )
    scene = {
        "ground": mesh("ground", ground, matte(texture(asphalt(random), repeat=(6, 15))), smooth=False),
        "wall": mesh("wall", wall, matte(texture(brick(random), repeat=(5, 3))), smooth=False),
        "stone": mesh("stone", joined(stone), matte(tones()), smooth=False),
        "frames": mesh("frames", joined(wood), coated(0.55), smooth=False),
        "iron": mesh("iron", joined(iron), coated(0.55)),
        "panes": mesh("panes", joined(panes), glossy(texture(pane(random)), 0.05), smooth=False),
        "fascia": mesh("fascia", board, matte(texture(prints.fascia(random))), smooth=False),
    }
    for k, x in enumerate((-0.75, 1.05)):
        pose = mi.ScalarTransform4f().translate([x + shift, 2.25, z + 0.02]).scale([0.30, 0.425, 1])
        scene[f"bill_{k}"] = {"type": "rectangle", "to_world": pose, "bsdf": matte(texture(prints.poster(random)))}
    return scene


def pane(random: np.random.Generator) -> np.ndarray:
    """What a window shows: roofs and sky mirrored in old glass, a blind behind it."""
    rows, columns = 280, 190
    y = (np.arange(rows)[:, None] + 0.5) / rows
    wavy = noise((rows, columns), (9, 6), random)
    roofs = 0.45 + 0.12 * noise((columns, 2), (5, 1), random)[None, :, 0] + 0.015 * wavy
    grey = np.where(
        y + 0 * wavy < roofs, 0.20 - 0.10 * y + 0.02 * wavy, 0.035 + 0.02 * cloudy((rows, columns), 5, 4, random)
    )
    blind = y < random.uniform(0.18, 0.4)
    return np.clip(np.where(blind, 0.30 + 0.03 * wavy, grey), 0.01, 0.6).astype(np.float32)


def brick(random: np.random.Generator) -> np.ndarray:
    """A wall in Flemish bond, 2.4 m × 2.4 m a repeat: each brick has its tone, some are burnt."""
    n = 1200
    y, x = np.mgrid[0:n, 0:n] / n * 2.4
    wave = 0.0022 * noise((n, n), (60, 60), random)
    row = np.floor((y + wave) / COURSE).astype(int)
    unit = np.mod((x + wave) / 0.36 + 0.5 * (row % 2), 20 / 3)
    long = np.mod(unit, 1) < 2 / 3  # a stretcher, then a header
    tone = random.normal(0.19, 0.035, (33, 14, 2))[row % 32, np.floor(unit).astype(int) % 14, long.astype(int)]
    burnt = random.random((33, 14, 2))[row % 32, np.floor(unit).astype(int) % 14, long.astype(int)] < 0.10
    tone = np.where(burnt, 0.5 * tone, tone)
    part = np.mod(unit, 1) * 0.36
    off = np.minimum(np.minimum(part, 0.36 - part), np.abs(part - 0.24))
    up = np.mod(y + wave, COURSE)
    off = np.minimum(off, np.minimum(up, COURSE - up)) + 0.0012 * noise((n, n), (400, 400), random)
    joint = np.clip((0.0062 - off) / 0.003, 0, 1)
    grit = noise((n, n), (n / 3, n / 3), random) + cloudy((n, n), 40, 3, random)
    grey = tone * (1 + 0.13 * grit) + joint * (0.30 + 0.03 * grit - tone * (1 + 0.13 * grit))
    grey *= 1 + 0.13 * cloudy((n, n), 3, 4, random)
    return np.clip(grey, 0.03, 0.6).astype(np.float32)


def asphalt(random: np.random.Generator) -> np.ndarray:
    """Grit, 4 m × 4 m a repeat; only its light is seen."""
    n = 400
    grey = 0.12 * (1 + 0.4 * noise((n, n), (n / 2, n / 2), random) + 0.25 * cloudy((n, n), 9, 4, random))
    return np.clip(grey, 0.03, 0.4).astype(np.float32)
