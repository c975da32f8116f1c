"""Snow falls round a signpost before a fir wood, under a grey sky, beside the lit windows of a hut.

World frame: metres, x right, y up, z towards the lens, which stands at the origin and looks along -z.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import sign
import wood
from solids import Body, box, grid, joined, placed, tube, turning
from surfaces import cloudy, matte, mesh, panel, texture, tones

# Sheets of flakes by distance (m); each falls as one, at its own speed.
SHEETS = ((3.0, 3.6), (3.4, 4.2), (3.6, 4.6), (5.0, 7.0), (5.2, 7.5), (6.5, 9.5), (8.0, 12.0), (9.0, 14.0))
BOARDS, GAP_M, THICK_M, POST_M = 2, 0.025, 0.022, 0.045
SKY_RADIANCE, HUT_RADIANCE, HUT_M = 1.1, 9.0, (0.9, 0.7)  # W m^-2 sr^-1


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1885, int(params["seed"])])
    scene = {"type": "scene", **_signpost(params, random), **_wood(random)}
    for k, (near, far) in enumerate(SHEETS):
        snow = wood.flakes(near, far, params, random)
        scene[f"snow_{k}"] = mesh(f"snow_{k}", snow, matte(0.88), smooth=False)
    middle = np.array([0.0, 0.0, -params["distance_m"]])
    hut = middle + np.array([params["hut_side"] * 1.5, 0.25, 1.6])
    return scene | {
        "sky": {"type": "constant", "radiance": SKY_RADIANCE},
        "hut": panel(hut, middle, HUT_M, HUT_RADIANCE),
    }


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """Every sheet falls at its own speed, and drifts with the wind, which is gusty."""
    random = np.random.default_rng([1886, int(params["seed"])])
    times = np.linspace(0, 1, 11)
    gust = np.cumsum(
        np.concatenate([[0.0], 0.1 * (1 + 0.5 * np.sin(2 * np.pi * times[:-1] + random.uniform(0, 6)))])
    )
    moved = {}
    for k in range(len(SHEETS)):
        fall, wind = params["fall_m_per_s"] * random.uniform(0.8, 1.0), params["wind_m_per_s"]
        wind += 0.05 * random.standard_normal()
        keyframes = [
            {"time_s": float(t), "translate_m": [float(wind * (g - gust[5])), float(-fall * (t - 0.5)), 0.0]}
            for t, g in zip(times, gust, strict=True)
        ]
        moved[f"snow_{k}"] = {"keyframes": keyframes}
    return moved


def _signpost(params: dict[str, Any], random: np.random.Generator) -> dict[str, Any]:
    """Two boards with a point at one end on a round post, and the snow on them."""
    wide, high = sign.BOARD_M
    fronts, sides, caps = [], [], []
    for k in range(BOARDS):
        way, aside = (-1) ** k, 0.05 * random.uniform(-1, 1)
        y = (k - 0.5) * (high + GAP_M) - 0.03
        front = grid(
            [
                [(-wide / 2, -high / 2, 0), (wide / 2, -high / 2, 0)],
                [(-wide / 2, high / 2, 0), (wide / 2, high / 2, 0)],
            ]
        )
        tip = grid(
            [
                [(way * wide / 2, -high / 2, 0), (way * (wide / 2 + 0.07), 0, 0)],
                [(way * wide / 2, high / 2, 0), (way * (wide / 2 + 0.07), 0, 0)],
            ]
        )
        tip = tip._replace(uv=np.array([[0.06, 0.3], [0.1, 0.45], [0.06, 0.7], [0.1, 0.55]]))
        lean = turning([0, 0, 1], float(random.normal(0, 1.2)))
        for body in (front, tip):
            body = body._replace(uv=np.column_stack([body.uv[:, 0], (k + body.uv[:, 1]) / BOARDS]))
            fronts.append(placed(body, [aside, y, THICK_M / 2 + POST_M], turn=lean))
        slab = box([-wide / 2, -high / 2, -THICK_M], [wide / 2, high / 2, -0.001], tone=0.15)
        sides.append(placed(slab, [aside, y, THICK_M / 2 + POST_M], turn=lean))
        snow = wood.cap(wide * 0.98, 0.05, 0.035 if k else 0.016, random)
        caps.append(placed(snow, [aside, y + high / 2 - 0.002, POST_M], turn=lean))
    top = (BOARDS - 0.5 - 0.5) * (high + GAP_M) + 0.10
    stem = tube([[0, -1.4, 0], [0, -0.5, 0], [0, 0, 0], [0, top, 0]], POST_M, around=24, tone=0.14)
    caps.append(placed(wood.cap(2.1 * POST_M, 2.1 * POST_M, 0.06, random), [0, top + POST_M * 0.6, 0]))
    bark = texture(0.15 * (1 + 0.4 * cloudy((700, 60), 6, 4, random)))
    turn, at = turning([0, 1, 0], params["turn_deg"]), [0.02, 0.0, -params["distance_m"]]

    def put(name: str, bodies: list[Body], bsdf: Any, *, smooth: bool = False) -> mi.Mesh:
        return mesh(name, placed(joined(bodies), at, turn=turn), bsdf, smooth=smooth)

    return {
        "boards": put("boards", fronts, matte(texture(sign.boards(BOARDS, random)))),
        "slabs": put("slabs", sides, matte(tones())),
        "post": put("post", [stem], matte(bark), smooth=True),
        "caps": put("caps", caps, matte(tones()), smooth=True),
    }


def _wood(random: np.random.Generator) -> dict[str, Any]:
    """The ground, firs scattered over it, and the dark edge of the wood behind them."""
    firs = []
    for _ in range(46):
        z = -float(random.uniform(8, 34))
        x = float(random.uniform(-0.16, 0.16)) * -z
        if abs(x) < 0.35 and z > -10:
            continue
        tree = wood.fir(float(random.uniform(0.9, 2.6)) * (0.6 + 0.02 * -z), random)
        firs.append(placed(tree, [x, float(wood.ground(np.array(x), np.array(z))) - 0.03, z]))
    rows, columns = 260, 900
    stems = np.repeat(random.uniform(0.3, 1.0, columns // 3), 3) ** 2
    edge = 0.10 * stems[None, :] * (1 + 0.5 * cloudy((rows, columns), 14, 4, random)) + 0.02
    veil = np.linspace(0.75, 0.1, rows)[:, None]
    edge = edge * (1 - veil) + veil * (0.16 + 0.06 * cloudy((rows, columns), 50, 3, random))
    back = mi.ScalarTransform4f().translate([0, 2.4, -45]).scale([14, 2.4, 1])
    return {
        "ground": mesh("ground", wood.hill(random), matte(tones())),
        "firs": mesh("firs", joined(firs), matte(tones())),
        "edge": {"type": "rectangle", "to_world": back, "bsdf": matte(texture(np.clip(edge, 0.01, 0.6)))},
    }
