"""A brick wall seen askew: a bill is posted on it, ivy climbs over it, the wall goes on far behind.

World frame: metres, x right, y up, z towards the lens, which stands at the origin and looks along -z. The
wall's own frame: x along it, y up, its face at z = 0; the middle of the bill at its origin.
"""

from __future__ import annotations

from typing import Any

import masonry
import numpy as np
from solids import Body, grid, joined, placed, rounded, tube, turning
from surfaces import matte, mesh, texture, tones

BILL_M, CURL_M = (0.46, 0.38), 0.012
ALONG_M, UP_M = (-2.2, 9.0), (-1.5, 1.5)  # of the wall; the lens looks at it 1.5 m above the ground
SUN_W, SUN_UP_DEG, SKY_RADIANCE = 44.0, 38.0, 5.0  # W m^-2; W m^-2 sr^-1
LEAVES, SHOOTS = 1500, 26


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1666, int(params["seed"])])
    side = 1 if params["side"] == "right" else -1
    turn = turning([0, 1, 0], side * params["turn_deg"])
    shift = np.array([0.0, 0.0, -params["distance_m"]])

    def put(name: str, body: Body, bsdf: Any, *, smooth: bool = False) -> Any:
        return mesh(name, placed(body, shift, turn=turn), bsdf, smooth=smooth)

    bricks, period = masonry.bricks(params, random)
    leaves, shoots = _ivy(params["ivy"], side, random)
    return {
        "type": "scene",
        "wall": put("wall", _wall(side, period), matte(texture(bricks, repeat=(1, 1)))),
        "bill": put("bill", _bill(), matte(texture(masonry.bill(BILL_M, random)))),
        "leaves": put("leaves", leaves, matte(tones())),
        "shoots": put("shoots", shoots, matte(tones()), smooth=True),
        "ground": put("ground", _ground(), matte(0.16)),
        **_lights(params, turn),
    }


def _wall(side: int, period: tuple[float, float]) -> Body:
    """The face; uv count periods of the picture."""
    left, right = sorted((side * ALONG_M[0], side * ALONG_M[1]))
    xs, ys = np.array([left, right]), np.array(UP_M)
    points = np.array([[(x, y, 0.0) for x in xs] for y in ys])
    uv = np.array([[(x / period[0], y / period[1]) for x in xs] for y in ys])
    return grid(points, uv=uv)


def _bill() -> Body:
    """Paper pasted on the wall, its lower corners curled off."""
    wide, high = BILL_M
    v, u = np.meshgrid(np.linspace(0, 1, 25), np.linspace(0, 1, 25), indexing="ij")
    curl = CURL_M * np.clip(np.abs(2 * u - 1) - v - 0.55, 0, 1) ** 1.5 / 0.3
    points = np.stack([(u - 0.5) * wide, (v - 0.5) * high, 0.0015 + curl], axis=2)
    return grid(points, uv=np.stack([u, v], axis=2))


def _ivy(share: float, side: int, random: np.random.Generator) -> tuple[Body, Body]:
    """Shoots that climb along the wall past the bill, with lobed leaves that face outwards."""
    leaves, shoots = [], []
    half = np.array([(0, 0), (0.32, -0.16), (0.52, 0.12), (0.36, 0.34), (0.46, 0.62), (0.2, 0.62), (0, 1)])
    ring = np.concatenate([half, (half * [-1, 1])[-2:0:-1]])
    for k in range(SHOOTS):
        x = side * (random.uniform(0.36, 1.5) if k % 3 else random.uniform(-0.9, -0.38))
        tall = random.uniform(0.5, 1.0) * (0.7 + 0.5 * share)
        knots = [(x, -0.62, 0.006)]
        for step in range(1, 5):
            aside = knots[-1][0] + random.normal(0, 0.05)
            knots.append((aside, -0.62 + tall * step / 4, random.uniform(0.004, 0.02)))
        path = rounded(knots)
        shoots.append(tube(path, np.linspace(5e-3, 1.5e-3, len(path)), around=7, tone=0.10))
        for _ in range(round(share * LEAVES / SHOOTS)):
            s = random.uniform()
            off = [0.05 * random.normal(), 0.02 * random.normal(), random.uniform(0.01, 0.04)]
            at = path[int(s * (len(path) - 1))] + np.array(off)
            if abs(at[0]) < BILL_M[0] / 2 + 0.02 and abs(at[1]) < BILL_M[1] / 2:
                continue
            size = random.uniform(0.025, 0.055)
            flat = np.column_stack([ring * size, 0.06 * size * np.cos(9 * ring[:, 1])])
            middle = np.broadcast_to([0.0, 0.35 * size, 0.12 * size], flat.shape)
            fan = grid(np.stack([flat, middle])[:, [*range(len(flat)), 0]])
            tone = random.uniform(0.05, 0.12)
            rim = np.concatenate([np.full(len(flat) + 1, tone), np.full(len(flat) + 1, 1.7 * tone)])
            turn = turning([0, 0, 1], 180 + random.normal(0, 45)) @ turning([1, 0, 0], random.normal(-15, 18))
            leaves.append(placed(fan._replace(tone=rim), at, turn=turn))
    return joined(leaves), joined(shoots)


def _ground() -> Body:
    return grid([[(-12, -1.5, 6), (12, -1.5, 6)], [(-12, -1.5, -1), (12, -1.5, -1)]])


def _lights(params: dict[str, Any], turn: np.ndarray) -> dict[str, Any]:
    azimuth, up = np.radians([params["sun_azimuth_deg"], SUN_UP_DEG])
    towards = turn @ np.array([np.sin(azimuth) * np.cos(up), np.sin(up), np.cos(azimuth) * np.cos(up)])
    return {
        "sun": {"type": "directional", "direction": (-towards).tolist(), "irradiance": SUN_W},
        "sky": {"type": "constant", "radiance": SKY_RADIANCE},
    }
