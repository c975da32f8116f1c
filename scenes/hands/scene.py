"""Two sculpted hands that speak by signs before a jersey and a papered wall; they sway a little.

World frame: metres, x right, y up, z towards the lens, which stands at z = 1.5; the nearer hand is at z = 0.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pictures
import sculpture
from solids import Body, grid, placed, turning
from surfaces import glossy, matte, mesh, panel, texture

M_PER_MM = 1e-3
ASIDE_M, DOWN_M = 0.078, 0.094  # of the wrists, from the middle of the picture
BODY_Z, WALL_Z = -0.42, -1.3
LAMP, WINDOW, ROOM = 11.0, 2.0, 0.09  # W m^-2 sr^-1
KNOTS, SWAYS = 21, 0.7  # keyframes; sways in a second


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1841, int(params["seed"])])
    tone, knit = float(params["skin"]), float(random.choice([0.05, 0.12, 0.3, 0.5]))
    scene: dict[str, Any] = {}
    for name in ("hand", "other"):
        made = sculpture.hand(str(params[f"{name}_gesture"]), random)
        body = Body(
            made.vertices, made.triangles, pictures.seen(made.vertices), np.full(len(made.vertices), 0.5)
        )
        skin = texture(pictures.skin(tone, made, str(params["side"]), random))
        turn, shift, mirror = _pose(name, params)
        put = placed(body, shift, turn=turn, scale=(mirror * M_PER_MM, M_PER_MM, M_PER_MM))
        scene[name] = mesh(name, put, glossy(skin, 0.36, ior=1.4))
        wool = matte(texture(pictures.wool(knit, random), repeat=(1, 1)))
        scene[f"{name}_cuff"] = mesh(f"{name}_cuff", placed(_cuff(), shift, turn=turn, scale=M_PER_MM), wool)
    return scene | _behind(knit, random) | _lights(params)


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """Each hand turns to and fro about its forearm, and is carried up and down and aside."""
    random = np.random.default_rng([1842, int(params["seed"])])
    times, made = np.linspace(0, 1, KNOTS), {}
    for name in ("hand", "other"):
        turn, shift, _ = _pose(name, params)
        swing, *way = (
            np.sin(2 * np.pi * SWAYS * (times - 0.5) + p) - np.sin(p) for p in random.uniform(0, 2 * np.pi, 3)
        )
        high = params["sway_mm"] * M_PER_MM
        keyframes = [
            {
                "time_s": float(t),
                "translate_m": [float(a * high), float(b * high), 0.0],
                "rotate_deg": float(r),
            }
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


def _cuff() -> Body:
    """The end of a sleeve, rolled."""
    angle = np.linspace(0, 2 * np.pi, 65)
    rings = [(46, 38, -300), (44, 36, -120), (43, 35, -70), (42, 34, -50), (40, 32, -47), (38, 29, -52)]
    points = [[(a * np.sin(t), y, b * np.cos(t) - 4) for t in angle] for a, b, y in rings]
    return grid(np.array(points))


def _behind(knit: float, random: np.random.Generator) -> dict[str, Any]:
    """The jersey's front, and the wall."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 61)
    aside = float(random.choice([-0.15, 0.15]))
    rows = [
        [(aside + 0.22 * np.sin(t), y, BODY_Z + 0.13 * (np.cos(t) - 1)) for t in angle] for y in (-0.4, 0.4)
    ]
    wall = mi.ScalarTransform4f().translate([0, 0, WALL_Z]).scale([1.2, 0.8, 1])
    return {
        "jersey": mesh(
            "jersey", grid(np.array(rows)), matte(texture(pictures.wool(knit, random), repeat=(4, 5)))
        ),
        "wall": {"type": "rectangle", "to_world": wall, "bsdf": matte(texture(pictures.paper(random)))},
    }


def _lights(params: dict[str, Any]) -> dict[str, Any]:
    side = -1 if params["lamp_side"] == "left" else 1
    return {
        "lamp": panel((0.65 * side, 0.6, 0.5), (0, 0, 0), (0.5, 0.5), LAMP),
        "window": panel((-1.0 * side, 0.5, 1.1), (0, 0, 0), (0.8, 1.2), WINDOW),
        "room": {"type": "constant", "radiance": ROOM},
    }
