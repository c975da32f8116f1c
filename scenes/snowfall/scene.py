"""Snow falls round a signpost in deep snow at the edge of a spruce wood, beside the lit window of a hut.

World frame: metres, x right, y up, z towards the lens, which stands at the origin and looks along -z.
"""

from __future__ import annotations

from typing import Any

import firs
import ground
import mitsuba as mi
import numpy as np
import sign
from solids import Body, joined, placed, turning
from surfaces import matte, mesh, panel, texture, tones

# Sheets of flakes by distance (m), how dense they are, their share of the speed; each falls as one.
SHEETS = (
    (1.7, 2.3, 0.5, 0.45), (2.3, 3.1, 0.7, 0.65), (3.1, 3.7, 1, 0.9), (3.5, 4.3, 1, 0.85), (3.7, 4.7, 1, 1.0),
    (5.0, 7.0, 1, 0.9), (5.2, 7.5, 1, 1.0), (6.5, 9.5, 1, 0.95), (8.0, 12.0, 1, 0.85), (9.0, 14.0, 1, 1.0),
)  # fmt: skip
BOARDS, GAP_M = 2, 0.03
SKY, HUT_RADIANCE, HUT_M = 1.15, 9.0, (0.9, 0.7)  # W m^-2 sr^-1
NEAR_FIRS = ((1.02, -0.55, 3.4), (-1.35, -1.7, 4.2))  # x, z from the sign, height
KINDS, FAR = 3, 30


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1909, int(params["seed"])])
    near = float(params["distance_m"])
    scene = {"type": "scene", **_signpost(params, random), **_ground(near, random), **_trees(params, random)}
    for k, (first, last, dense, _) in enumerate(SHEETS):
        snow = ground.flakes(first, last, dense * params["flakes_per_m3"], params["flake_mm"], random)
        scene[f"snow_{k}"] = mesh(f"snow_{k}", snow, matte(0.88), smooth=False)
    middle = np.array([0.0, 0.0, -near])
    hut = middle + np.array([params["hut_side"] * 1.5, 0.25, 1.6])
    return scene | {"sky": _sky(params), "hut": panel(hut, middle, HUT_M, HUT_RADIANCE)}


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """Every sheet falls at its own speed, and drifts with the wind, which is gusty."""
    random = np.random.default_rng([1910, int(params["seed"])])
    times = np.linspace(0, 1, 11)
    gust = np.cumsum(np.concatenate([[0.0], 0.1 * (1 + 0.5 * np.sin(2 * np.pi * times[:-1] + random.uniform(0, 6)))]))
    moved = {}
    for k, (_, _, _, share) in enumerate(SHEETS):
        fall = share * params["fall_m_per_s"] * random.uniform(0.9, 1.0)
        wind = share * (params["wind_m_per_s"] + 0.05 * random.standard_normal())
        keyframes = [
            {"time_s": float(t), "translate_m": [float(wind * (g - gust[5])), float(-fall * (t - 0.5)), 0.0]}
            for t, g in zip(times, gust, strict=True)
        ]
        moved[f"snow_{k}"] = {"keyframes": keyframes}
    return moved


def _sky(params: dict[str, Any]) -> dict[str, Any]:
    """An overcast sky, three times as bright at the zenith, brighter on the side away from the hut."""
    rows, columns = 32, 64
    up = np.cos((np.arange(rows) + 0.5) / rows * np.pi)[:, None]
    turn = (np.arange(columns) + 0.5) / columns * 2 * np.pi
    side = np.sin(turn)[None, :] * params["hut_side"]
    picture = np.where(up > 0, SKY * (1 + 2 * up) / 3 * 1.5 * (1 + 0.55 * side), 0.35 * SKY)
    return {"type": "envmap", "bitmap": mi.Bitmap(picture.astype(np.float32)[:, :, None].repeat(3, axis=2))}


def _signpost(params: dict[str, Any], random: np.random.Generator) -> dict[str, Any]:
    """Two boards on a post, and the snow on them."""
    high = sign.BOARD_M[1]
    turn, at = turning([0, 1, 0], params["turn_deg"]), np.array([0.02, 0.0, -params["distance_m"]])
    dark = bool(random.random() < 0.5)
    names = random.choice(sign.PLACES, BOARDS, replace=False)
    scene, edges, caps = {}, [], []
    for k in range(BOARDS):
        way = (-1) ** k
        shift = np.array([0.05 * random.uniform(-1, 1), (k - 0.5) * (high + GAP_M) + 0.035, sign.POST_M + sign.THICK_M])
        lean = turning([0, 0, 1], float(random.normal(0, 1.2)))
        front, edge = sign.board(way, random)
        grey, relief = sign.face(way, str(names[k]), dark, random)
        wood = {"type": "diffuse", "reflectance": texture(grey)}
        bumped = {"type": "bumpmap", "height": texture(relief / sign.PICTURE_M[1]), "bsdf": wood}
        body = placed(placed(front, shift, turn=lean), at, turn=turn)
        scene[f"board_{k}"] = mesh(f"board_{k}", body, {"type": "twosided", "bsdf": bumped}, smooth=True)
        edges.append(placed(edge, shift, turn=lean))
        snow = sign.cap(sign.BOARD_M[0] * 0.96, 0.062, 0.040 if k else 0.016, random)
        caps.append(placed(snow, shift + np.array([0, high / 2, -sign.THICK_M / 2]), turn=lean))
    top = BOARDS / 2 * (high + GAP_M) + 0.095
    caps.append(placed(sign.cap(2.1 * sign.POST_M, 2.3 * sign.POST_M, 0.045, random), [0, top - 0.004, 0]))

    def put(name: str, bodies: list[Body], *, smooth: bool) -> mi.Mesh:
        return mesh(name, placed(joined(bodies), at, turn=turn), matte(tones()), smooth=smooth)

    return scene | {
        "edges": put("edges", edges, smooth=False),
        "post": put("post", [sign.post(top, random)], smooth=True),
        "caps": put("caps", caps, smooth=True),
    }


def _ground(near: float, random: np.random.Generator) -> dict[str, Any]:
    foot = (0.02, -near)
    back = mi.ScalarTransform4f().translate([0, 3.0, -48]).scale([11, 3.0, 1])
    wood = matte(texture(ground.far_wood(random)))
    return {
        "bank": mesh("bank", ground.bank(near, foot, random), matte(tones())),
        "slope": mesh("slope", ground.slope(near, random), matte(tones())),
        "grass": mesh("grass", ground.stems(near, foot, random), matte(tones())),
        "far_wood": {"type": "rectangle", "to_world": back, "bsdf": wood},
    }


def _trees(params: dict[str, Any], random: np.random.Generator) -> dict[str, Any]:
    """Spruces close behind the sign, needle by needle; others up the slope: copies of few boughs."""
    near, side = float(params["distance_m"]), float(params["hut_side"])
    fine = [firs.bough(1.0, random, needle_m=0.021, step_m=0.0022, twig_m=0.045, cell_m=0.012) for _ in range(KINDS)]
    grown = []
    for x, z, high in NEAR_FIRS:
        foot = np.array([side * x, -1.05, -near + z])
        turn = turning([0, 1, 0], random.uniform(0, 360))
        grown += firs.tree(fine, high, foot, turn=turn, random=random)
    coarse = [firs.bough(1.0, random, needle_m=0.08, step_m=0.016, twig_m=0.11, cell_m=0.035) for _ in range(KINDS)]
    far = []
    for _ in range(FAR):
        z = -near - 4.5 - 36 * random.uniform(0, 1) ** 1.3
        x = random.uniform(-0.15, 0.15) * -z
        foot = np.array([x, float(ground.height(np.array(x), np.array(z), near)) - 0.1, z])
        turn = turning([0, 1, 0], random.uniform(0, 360))
        far += firs.tree(coarse, float(random.uniform(2.0, 5.0)), foot, turn=turn, random=random)
    return _meshes("near", firs.together(grown), 1.0) | _meshes("far", firs.together(far), 1.7)


def _meshes(name: str, made: firs.Tree, veil: float) -> dict[str, Any]:
    """``veil``: how much paler the air makes what is dark."""
    reflectances = firs.NEEDLE * veil, firs.DUSTED, firs.BARK * veil, firs.SNOW
    return {
        f"{name}_{part}": mesh(f"{name}_{part}", body, matte(reflectance), smooth=part == "load")
        for part, body, reflectance in zip(made._fields, made, reflectances, strict=True)
    }
