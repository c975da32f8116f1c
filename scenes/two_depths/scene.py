"""Two equal nesting dolls on a shelf, one nearer and one farther; a music box turns one of them.

World frame: metres, x right, y up, z towards the lens, which stands at z = 0.9; the shelf is y = 0.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pictures
from solids import Body, ball, grid, placed, rounded, turned, turning
from surfaces import glossy, matte, mesh, panel, texture

M_PER_MM = 1e-3
LIFT_M = 0.012  # of the turning doll: the plate of the music box; the other stands on a foot as high
LAMP, WINDOW, ROOM = 34.0, 4.2, 0.16  # W m^-2 sr^-1
# Outline of a doll, (radius, height) in mm from the foot up.
OUTLINE = (
    (21, 0.3), (23.5, 2), (27.5, 12), (30, 27), (29.5, 42), (25.5, 55), (21, 61.5), (20.4, 66), (22.6, 74),
    (22.6, 84), (19, 93), (11, 99), (0, 101),
)  # fmt: skip


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng(int(params["paint_seed"]))
    painted = texture(pictures.doll(float(params["contrast"]), random))
    coat = mi.load_dict(glossy(painted, 0.22))
    body = _doll()
    names = {"near": "target", "far": "other"} if params["target"] == "near" else {"near": "other", "far": "target"}
    plate = mi.load_dict(glossy(texture(pictures.box(random), repeat=(1, 4.5)), 0.25))
    scene: dict[str, Any] = {}
    for which, name in names.items():
        turn = turning([0, 1, 0], float(params["phase_deg"]) * (1 if which == params["turns"] else 0.6))
        scene[name] = mesh(name, placed(body, _place(params, which), turn=turn, scale=M_PER_MM), coat)
        foot = placed(_foot(), _place(params, which) - (0, LIFT_M, 0))
        scene[f"box_{which}"] = mesh(f"box_{which}", foot, plate)
    return scene | _shelf(random) | _lights(params)


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """One doll turns evenly about its upright by ``turn_deg`` in a second."""
    name = "target" if params["turns"] == params["target"] else "other"
    half = float(params["turn_deg"]) / 2
    frames = [{"time_s": 0.0, "rotate_deg": -half}, {"time_s": 1.0, "rotate_deg": half}]
    return {name: {"axis": [0, 1, 0], "centre_m": _place(params, params["turns"]).tolist(), "keyframes": frames}}


def _place(params: dict[str, Any], which: str) -> np.ndarray:
    """Where the foot of a doll stands."""
    side = -1 if params["side"] == "left" else 1
    if which == "near":
        return np.array([0.040 * side, LIFT_M, float(params["near_m"])])
    return np.array([-0.052 * side, LIFT_M, -float(params["far_m"])])


def _doll() -> Body:
    """In millimetres; its face looks along +z, and the middle of its picture lies there."""
    made = turned(rounded(OUTLINE, steps=8), around=120)
    return made._replace(uv=np.stack([np.mod(made.uv[:, 0] + 0.5, 1.0), made.uv[:, 1]], axis=1))


def _foot() -> Body:
    """A low round box with inlays."""
    rim = LIFT_M
    return turned([(0.036, 0), (0.037, 0.001), (0.037, rim - 0.0015), (0.036, rim - 0.0003), (0, rim - 0.0003)])


def _shelf(random: np.random.Generator) -> dict[str, Any]:
    """Boards, a papered wall, and wooden balls: before the dolls, between them, behind them."""
    flat = grid([[(-0.45, 0, 0.42), (0.45, 0, 0.42)], [(-0.45, 0, -0.48), (0.45, 0, -0.48)]])
    back = grid([[(-0.6, -0.15, -0.62), (0.6, -0.15, -0.62)], [(-0.6, 0.65, -0.62), (0.6, 0.65, -0.62)]])
    wood = pictures.boards(random)
    scene = {
        "shelf": mesh("shelf", flat, glossy(texture(wood), 0.35), smooth=False),
        "wall": mesh("wall", back, matte(texture(pictures.wall(random))), smooth=False),
    }
    grain = glossy(texture(wood[:400, :800]), 0.25)
    places = (
        (0.02, 0.20, 0.013),
        (-0.075, -0.06, 0.011),
        (0.09, -0.02, 0.014),
        (0.01, -0.33, 0.03),
        (0.13, -0.40, 0.045),
    )
    for k, (x, z, radius) in enumerate(places):
        centre = (x + float(random.uniform(-0.006, 0.006)), radius, z)
        scene[f"ball_{k}"] = mesh(f"ball_{k}", ball(centre, radius, rings=24, around=48), grain)
    return scene


def _lights(params: dict[str, Any]) -> dict[str, Any]:
    side = 1 if params["side"] == "left" else -1
    return {
        "lamp": panel((0.55 * side, 0.60, 0.62), (0, 0.05, -0.03), (0.28, 0.28), LAMP),
        "window": panel((-1.1 * side, 0.7, 0.35), (0, 0.05, -0.03), (0.9, 1.1), WINDOW),
        "room": {"type": "constant", "radiance": ROOM},
    }
