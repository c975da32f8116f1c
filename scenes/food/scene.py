"""A roll, a block of blue cheese and berries on a board: one of them is the target, the others lie behind it.

World frame: millimetres, x right, y up, z towards the lens, looking down by 38 degrees; the board is y = 0.
"""

from __future__ import annotations

from typing import Any

import eaten
import numpy as np
import pictures
from solids import Body, grid, placed, turning
from surfaces import glossy, matte, mesh, panel, texture, tones

WINDOW, CEILING, ROOM = 2.2, 1.1, 0.12  # W m^-2 sr^-1
SELDOM = 0.1  # rays towards the room, which chance finds often enough
FOODS = ("roll", "cheese", "berries")
BEHIND = ((-40.0, -33.0), (36.0, -52.0))  # x, z of the other two


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (millimetres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1825, int(params["seed"])])
    foods = {
        "roll": eaten.roll(float(params["flour"]), random),
        "cheese": eaten.cheese(random),
        "berries": eaten.berries(random),
    }
    skins = {
        "roll": glossy(texture(pictures.crust(float(params["flour"]), random)), 0.45),
        "cheese": matte(tones()),
        "berries": _juicy(),
    }
    side = float(params["mirrored"])
    turn = turning([0, 1, 0], float(params["turn_deg"]))
    scene = {
        "type": "scene",
        "target": mesh(
            "target",
            placed(foods[params["target"]], (0, 0, float(params["nearer_mm"])), turn=turn),
            skins[params["target"]],
        ),
    }
    others = [name for name in FOODS if name != params["target"]]
    for name, (x, z) in zip(others, BEHIND, strict=True):
        shift = (side * x + random.uniform(-2, 2), 0, z + random.uniform(-3, 3))
        pose = turning([0, 1, 0], -side * np.sign(x) * 18 + random.uniform(-12, 12))
        scene[name] = mesh(name, placed(foods[name], shift, turn=pose), skins[name])
    scene["thyme"] = mesh("thyme", eaten.thyme(side, random), matte(tones()))
    scene["crumbs"] = mesh("crumbs", eaten.crumbs(random), matte(tones()), smooth=False)
    scene["board"] = mesh("board", _board(), glossy(texture(pictures.board(random)), 0.4), smooth=False)
    return scene | _lights(float(params["window_azimuth_deg"]))


def _juicy() -> dict[str, Any]:
    """A skin in the tones of its mesh, with highlights as of wax."""
    return {"type": "twosided", "bsdf": {"type": "principled", "base_color": tones(), "roughness": 0.5}}


def _board() -> Body:
    wide, near, far = pictures.BOARD_MM[0] / 2, 130.0, 130.0 - pictures.BOARD_MM[1]
    return grid([[(-wide, 0, near), (wide, 0, near)], [(-wide, 0, far), (wide, 0, far)]])


def _lights(azimuth_deg: float) -> dict[str, Any]:
    """A window low behind or beside, the ceiling that it lights, the room."""
    a = np.radians(azimuth_deg)
    origin = np.array([430 * np.sin(a), 270, 430 * np.cos(a)])
    ceiling: dict[str, Any] = panel((0, 900, 250), (0, 0, 0), (900, 700), CEILING)
    room: dict[str, Any] = {"type": "constant", "radiance": ROOM, "sampling_weight": SELDOM}
    return {"window": panel(origin, (0, 10, 0), (380, 300), WINDOW), "ceiling": ceiling, "room": room}
