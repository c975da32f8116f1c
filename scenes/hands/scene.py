"""Two hands that speak by signs before somebody's pullover and a room; they sway a little.

World frame: metres, x right, y up, z towards the lens, which stands at z = 1.8; the nearer hand is at z = 0.
"""

from __future__ import annotations

from typing import Any

import hand
import numpy as np
import skin
from knit import LOOPS, stitch
from living_room import room
from solids import Body, grid, placed, turning
from surfaces import cloudy, matte, mesh, panel, texture

from saf_gen.render.meshes import make_mesh

M_PER_MM = 1e-3
ASIDE_M, DOWN_M = 0.088, 0.092  # of the wrists, from the middle of the picture
BODY_Z, WALL_Z = -0.40, -1.5
LAMP, WINDOW, ROOM = 11.0, 2.0, 0.09  # W m^-2 sr^-1
KNOTS, SWAYS = 21, 0.7  # keyframes; sways in a second
STITCH_M = 3.4e-3
LOOP_DEPTH = 0.25  # of the stitch's contrast


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([2841, int(params["seed"])])
    tone, knit = float(params["skin"]), float(random.choice([0.05, 0.12, 0.3, 0.5]))
    # The loops of a worn pullover are filled: at full depth they would be sharper than the hand before them.
    loops = stitch(knit, random)
    loops = loops.mean() + LOOP_DEPTH * (loops - loops.mean())
    wool = matte(texture(loops, repeat=(1 / LOOPS[0], 1 / LOOPS[1])))
    scene: dict[str, Any] = {}
    for name in ("hand", "other"):
        build_ = np.random.default_rng([2843, int(params["seed"])])  # both hands are one person's
        made = hand.hand(str(params[f"{name}_gesture"]), params, build_)
        looks = skin.skin(tone, made, float(params["age_years"]), random)
        turn, shift, mirror = _pose(name, params)
        matrix = turn * [mirror, 1, 1]
        scene[name] = make_mesh(
            name,
            made.vertices * M_PER_MM @ matrix.T + shift,
            faces=made.triangles if mirror > 0 else made.triangles[:, ::-1],
            bsdf=_skin(looks),
            uv=made.uv,
            normals=made.normals @ matrix.T,
        )
        cuff = placed(_cuff(made), shift, turn=turn, scale=(mirror * M_PER_MM, M_PER_MM, M_PER_MM))
        scene[f"{name}_cuff"] = mesh(f"{name}_cuff", cuff, wool)
    scene["pullover"] = mesh("pullover", _pullover(random), wool)
    return scene | room(random, wall_z=WALL_Z, low=-0.5) | _lights(params)


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """Each hand turns to and fro about its forearm, and is carried up and down and aside."""
    random = np.random.default_rng([2842, int(params["seed"])])
    times, made = np.linspace(0, 1, KNOTS), {}
    for name in ("hand", "other"):
        turn, shift, _ = _pose(name, params)
        swing, *way = (
            np.sin(2 * np.pi * SWAYS * (times - 0.5) + p) - np.sin(p) for p in random.uniform(0, 2 * np.pi, 3)
        )
        high = params["sway_mm"] * M_PER_MM
        keyframes = [
            {"time_s": float(t), "translate_m": [float(a * high), float(b * high), 0.0], "rotate_deg": float(r)}
            for t, a, b, r in zip(times, *way, params["turn_deg"] * swing, strict=True)
        ]
        held = {"axis": turn[:, 1].tolist(), "centre_m": shift.tolist(), "keyframes": keyframes}
        made |= {name: held, f"{name}_cuff": held}
    return made


def _pose(name: str, params: dict[str, Any]) -> tuple[np.ndarray, np.ndarray, int]:
    """Rotation (3, 3) and shift (m) of a hand, and -1 for a left one, which mirrors x."""
    first = 1 if params["hand_side"] == "left" else -1  # where the hand of the target stands
    side = first if name == "hand" else -first
    lean = turning([0, 0, 1], side * float(params["lean_deg"]))
    face = turning([0, 1, 0], side * float(params["yaw_deg"]) + (180 if params["side"] == "back" else 0))
    depth = float(params["nearer_m"]) if name == "hand" else float(params["behind_m"])
    mirror = side if params["side"] == "palm" else -side
    return lean @ face, np.array([-side * ASIDE_M, -DOWN_M, depth]), mirror


def _skin(looks: skin.Skin) -> dict[str, Any]:
    """A rough coat of index 1.4 over a ground, with furrows, veins and creases as relief."""
    coat = {
        "type": "principled",
        "base_color": texture(looks.grey),
        "roughness": texture(looks.rough),
        "eta": 1.4,
        "flatness": 0.5,
        "sheen": 0.1,
    }
    return {"type": "bumpmap", "relief": texture(looks.relief), "bsdf": coat}


def _cuff(made: hand.Hand) -> Body:
    """The end of a sleeve over the wrist, ribbed and a little wide."""
    near = made.rest[(made.rest[:, 1] < -15) & (made.rest[:, 1] > -60)]
    middle, half = (near.max(axis=0) + near.min(axis=0)) / 2, (near.max(axis=0) - near.min(axis=0)) / 2
    angle = np.linspace(0, 2 * np.pi, 241)
    profile = [(26, -320), (14, -108), (9, -78), (7.5, -70), (5.5, -62), (5, -30), (4.2, -26), (2.6, -25), (1.2, -30)]
    rib = 0.55 * np.cos(44 * angle)
    rows, uv = [], []
    for wide, y in profile:
        ribs = rib * (y > -68) + (0.9 * np.sin(3 * angle + y / 9) + 1.2 * np.sin(2 * angle - y / 23)) * (y < -73)
        a, b = half[0] + wide + ribs, half[2] + wide + ribs
        rows.append(np.stack([middle[0] + a * np.sin(angle), y + 0 * angle, middle[2] + b * np.cos(angle)], axis=1))
        uv.append(np.stack([angle / (2 * np.pi) * 64, np.full(angle.size, y / 1e3 / STITCH_M)], axis=1))
    return grid(np.array(rows), uv=np.array(uv))


def _pullover(random: np.random.Generator) -> Body:
    """The front of the speaker, with folds."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 161)
    height = np.linspace(-0.45, 0.45, 121)[:, None]
    aside = float(random.choice([-0.12, 0.12]))
    fold = 0.012 * cloudy((121, 161), 9, 3, random)
    x = aside + (0.23 + fold) * np.sin(angle)
    z = BODY_Z + (0.14 + fold) * (np.cos(angle)) - 0.14
    points = np.stack(np.broadcast_arrays(x, height, z), axis=2)
    uv = np.stack(np.broadcast_arrays(angle * 0.23 / STITCH_M, height / STITCH_M), axis=2)
    return grid(points, uv=uv)


def _lights(params: dict[str, Any]) -> dict[str, Any]:
    side = -1 if params["lamp_side"] == "left" else 1
    return {
        "lamp": panel((0.65 * side, 0.6, 0.6), (0, 0, 0), (0.5, 0.5), LAMP),
        "window": panel((-1.0 * side, 0.5, 1.1), (0, 0, 0), (0.8, 1.2), WINDOW),
        "room": {"type": "constant", "radiance": ROOM},
    }
