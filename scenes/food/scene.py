"""Bread, blue cheese and grapes on a worn board: one of them is the target, the others lie behind it.

World frame: millimetres, x right, y up, z towards the lens, looking down by 31 degrees; the board is y = 0.
"""

from __future__ import annotations

from typing import Any

import breads
import cheeses
import garnish
import numpy as np
import surround
from solids import placed, turning
from surfaces import matte, mesh, panel, tones

WINDOW, CEILING, ROOM = 7.0, 0.9, 0.10  # W m^-2 sr^-1
SELDOM = 0.1  # rays towards the room, which chance finds often enough
FOODS = ("bread", "cheese", "grapes")
BEHIND = ((-43.0, -42.0), (40.0, -62.0))  # x, z of the other two
FINE, COARSE = {"bread": 0.24, "cheese": 0.22, "grapes": 110}, {"bread": 0.5, "cheese": 0.42, "grapes": 50}
LOAF, RIND_DEG = 0.80, 30.0  # size of the bread, turn of the cheese


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (millimetres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1931, int(params["seed"])])
    side, chosen, flour = float(params["mirrored"]), str(params["target"]), float(params["flour"])
    places = {chosen: ((5.0 * side, 0.0, float(params["nearer_mm"])), float(params["turn_deg"]))}
    others = [name for name in FOODS if name != chosen]
    for name, (x, z) in zip(others, BEHIND, strict=True):
        shift = (side * x + random.uniform(-2, 2), 0.0, z + random.uniform(-3, 3))
        places[name] = shift, -side * np.sign(x) * 20 + random.uniform(-12, 12)
    scene: dict[str, Any] = {"type": "scene"}
    for name in FOODS:
        shift, turn_deg = places[name]
        turn = turning([0, 1, 0], turn_deg)
        detail = (FINE if name == chosen else COARSE)[name]
        shape = "target" if name == chosen else name
        if name == "bread":
            body = placed(breads.loaf(detail, flour, random), shift, turn=turn, scale=LOAF)
            scene[shape] = mesh(shape, body, matte(tones()))
        elif name == "cheese":
            facing = turning([0, 1, 0], turn_deg - RIND_DEG)  # so that its rind shows
            body = placed(cheeses.wedge(detail, random), shift, turn=facing)
            scene[shape] = mesh(shape, body, _skin(0.62))
        else:
            berries, stalks = garnish.grapes(int(detail), random)
            scene[shape] = mesh(shape, placed(berries, shift, turn=turn), _skin(0.33))
            scene["stalks"] = mesh("stalks", placed(stalks, shift, turn=turn), matte(tones()))
    bread, cheese = places["bread"][0], places["cheese"][0]
    sprigs = [
        garnish.rosemary((-side * 58, 1.6, 30), (side, 0.0, 0.35), 42, random),
        garnish.rosemary((side * 62, 1.6, -8), (-side * 0.5, 0.05, -0.9), 60, random),
    ]
    strewn = [(bread[0], bread[2] + 14, 26, 150, 0.5), (cheese[0], cheese[2] + 14, 14, 60, 0.6), (0, 0, 60, 60, 0.4)]
    scene["rosemary"] = mesh("rosemary", garnish.joined(sprigs), _skin(0.5))
    scene["crumbs"] = mesh("crumbs", garnish.crumbs(strewn, random), matte(tones()), smooth=False)
    scene |= surround.table((bread[0], bread[2] + 10), flour, random)
    return scene | _lights(float(params["window_azimuth_deg"]))


def _skin(roughness: float) -> dict[str, Any]:
    """A surface in the tones of its mesh under a coat: wax, grease, leaf."""
    coat = {"type": "principled", "base_color": tones(), "roughness": roughness}
    return {"type": "twosided", "bsdf": coat}


def _lights(azimuth_deg: float) -> dict[str, Any]:
    """A window low behind or beside, the ceiling that it lights, the room."""
    a = np.radians(azimuth_deg)
    origin = np.array([480 * np.sin(a), 250, 480 * np.cos(a)])
    ceiling: dict[str, Any] = panel((0, 900, 250), (0, 0, 0), (900, 700), CEILING)
    room: dict[str, Any] = {"type": "constant", "radiance": ROOM, "sampling_weight": SELDOM}
    return {"window": panel(origin, (0, 10, 0), (320, 260), WINDOW), "ceiling": ceiling, "room": room}
