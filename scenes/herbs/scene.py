"""Pots of herbs on a wooden table by a window: a named one in the middle, others before and behind it.

World frame: metres, x right, y up, z towards the lens; rims of the pots at y = 0, the table below. The lens
stands 0.10 m above the rims at z = 0.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import plants
from solids import Body, ball, grid, joined, placed, turned, turning
from stroke_font import drawn, lines
from surfaces import cloudy, glossy, matte, mesh, noise, panel, texture, tones

POT_R, POT_H, SOIL_Y = 0.044, 0.080, -0.010
LABEL_M, LABEL_TEXEL_M = (0.013, 0.062), 0.00012
# Other pots: x, z from the target's axis, size.
OTHERS = ((-0.125, 0.075, 0.85), (0.135, -0.13, 1.1), (-0.12, -0.21, 1.15), (0.03, -0.36, 1.2), (-0.30, -0.42, 1.2))
WALL_Z, WINDOW_M, WINDOW_RADIANCE, ROOM_RADIANCE = -0.85, (1.0, 1.2), 2.2, 0.35  # from the axis; W m^-2 sr^-1


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1754, int(params["seed"])])
    herb, at = str(params["herb"]), np.array([params["aside_m"], 0.0, -params["distance_m"]])
    turn = turning([0, 1, 0], params["turn_deg"])
    leaf = glossy(texture(plants.leaf_picture(params["green"], random)), 0.38)
    clay = matte(texture(_clay(params["clay"], random)))
    green, wood = plants.KINDS[herb](random)

    def put(name: str, body: Body, bsdf: Any, *, smooth: bool = True) -> mi.Mesh:
        return mesh(name, placed(body, at, turn=turn), bsdf, smooth=smooth)

    kinds = [kind for kind in plants.KINDS if kind != herb]
    others, stalks, pots = [], [], []
    for k, (x, z, size) in enumerate(OTHERS):
        off = [x + random.uniform(-0.012, 0.012), 0.0, z + random.uniform(-0.015, 0.015)]
        shift = at + np.array(off)
        pose = {"turn": turning([0, 1, 0], random.uniform(0, 360)), "scale": size}
        for kept, body in zip((others, stalks), plants.KINDS[kinds[k % 3]](random), strict=True):
            kept.append(placed(body, shift, **pose))
        pots.append(placed(_pot(), shift, **pose))
    return {
        "type": "scene",
        "leaves": put("leaves", green, leaf),
        "stems": put("stems", wood, matte(tones())),
        "pot": put("pot", _pot(), clay),
        "label": put("label", _label(), matte(texture(_lettered(herb, random))), smooth=False),
        "other_leaves": mesh("other_leaves", joined(others), leaf),
        "other_stems": mesh("other_stems", joined(stalks), matte(tones())),
        "other_pots": mesh("other_pots", joined(pots), clay),
        "soil": mesh("soil", placed(_soil(random), at), matte(tones())),
        **_table(at, random),
        **_lights(at, params["window_azimuth_deg"]),
    }


def _pot() -> Body:
    """A thrown pot with a collar: outside from the foot to the rim, then inside down to the soil."""
    r, h = POT_R, POT_H
    outline = [
        (0.0, -h), (0.68 * r, -h), (0.70 * r, -h + 0.002), (0.90 * r, -0.0230), (0.905 * r, -0.0215),
        (0.99 * r, -0.0210), (r, -0.0195), (r, -0.0015), (0.985 * r, 0.0), (0.91 * r, 0.0),
        (0.895 * r, -0.0015), (0.88 * r, -0.014), (0.0, -0.014),
    ]  # fmt: skip
    return turned(outline, around=120)


def _clay(tone: float, random: np.random.Generator) -> np.ndarray:
    """Terracotta: turning rings, bloom of lime, stains that run down."""
    shape = (700, 1400)
    grey = tone * (1 + 0.10 * noise(shape, (160, 3), random) + 0.16 * cloudy(shape, 14, 5, random))
    grey *= 1 - 0.35 * np.clip(noise(shape, (5, 70), random) - 0.3, 0, 1)
    lime = np.clip(2.2 * cloudy(shape, 22, 6, random) - 0.75, 0, 1)
    grey += 0.6 * lime * (0.62 - grey)
    grey *= 1 + 0.10 * noise(shape, (350, 700), random)
    return np.clip(grey, 0.04, 0.7)


def _soil(random: np.random.Generator) -> Body:
    made = []
    for _ in range(260):
        r, a = 0.87 * POT_R * np.sqrt(random.uniform()), random.uniform(0, 2 * np.pi)
        size = 1e-3 * random.uniform(0.8, 2.4, 3)
        centre = [r * np.cos(a), SOIL_Y + random.uniform(-0.001, 0.001), r * np.sin(a)]
        tone = random.choice([0.02, 0.035, 0.06, 0.3], p=[0.4, 0.35, 0.2, 0.05])
        made.append(ball(centre, size, rings=5, around=7, tone=tone))
    return joined(made)


def _label() -> Body:
    """A wooden stick at the front of the pot, leaning back."""
    wide, high = LABEL_M
    share = np.linspace(0, 1, 9)[:, None]
    across = np.array([-0.5, 0.5])[None, :] * wide
    stick = grid(np.stack(np.broadcast_arrays(across, share * high - 0.034, 0 * share), axis=2))
    return placed(stick, [0.021, 0.0, 0.0455], turn=turning([0, 0, 1], -7) @ turning([1, 0, 0], -4))


def _lettered(herb: str, random: np.random.Generator) -> np.ndarray:
    """The stick's picture: grain of the wood, the herb's name written up it."""
    x, y = ((np.arange(round(side / LABEL_TEXEL_M)) + 0.5) * LABEL_TEXEL_M - side / 2 for side in LABEL_M)
    shape = y.size, x.size
    grey = 0.56 * (1 + 0.10 * noise(shape, (6, shape[1] / 3), random) + 0.06 * cloudy(shape, 3, 4, random))
    along, across = np.sort(y), np.sort(x)
    ink = drawn(along, across, lines(herb.upper(), 0.0062, (0.004, 0.0)), 0.0010)
    ink = np.rot90(ink[::-1])  # reads upwards
    grey = np.where(np.abs(x)[None, :] < 2, grey + ink * (0.06 - grey), grey)
    return np.clip(grey, 0.03, 0.8)


def _table(at: np.ndarray, random: np.random.Generator) -> dict[str, Any]:
    """Planks along x, and a plastered wall behind."""
    shape = (1500, 1500)
    plank = random.uniform(0.75, 1.2, 12).repeat(shape[0] // 12)
    gap = np.minimum(np.arange(shape[0]) % 125, 3) / 3.0
    grey = 0.24 * np.resize(plank, shape[0])[:, None] * np.resize(0.25 + 0.75 * gap, shape[0])[:, None]
    grey = grey * (1 + 0.22 * noise(shape, (400, 12), random) + 0.10 * cloudy(shape, 20, 4, random))
    low, z = -POT_H, at[2]
    board = grid([[(x, low, z + far) for x in (-0.75, 0.75)] for far in (0.45, -0.7)])
    wall = 0.30 * (1 + 0.14 * cloudy((500, 800), 9, 6, random))
    pose = mi.ScalarTransform4f().translate([0, 0.3, z + WALL_Z]).scale([1.4, 0.7, 1])
    return {
        "table": mesh("table", board, glossy(texture(np.clip(grey, 0.03, 0.6)), 0.35), smooth=False),
        "wall": {"type": "rectangle", "to_world": pose, "bsdf": matte(texture(wall))},
    }


def _lights(at: np.ndarray, azimuth_deg: float) -> dict[str, Any]:
    azimuth = np.radians(azimuth_deg)
    away = np.array([1.05 * np.sin(azimuth), 0.55, 1.05 * np.cos(azimuth)])
    radiance = WINDOW_RADIANCE / (0.35 + 0.65 * float(np.cos(azimuth)))  # as bright from any side
    return {"window": panel(at + away, at, WINDOW_M, radiance), "room": {"type": "constant", "radiance": ROOM_RADIANCE}}
