"""A sculpted head before a papered wall with a print; it turns slowly about its neck.

World frame: metres, x right, y up, z towards the lens, which stands at z = 1.8; the eyes are near y = 0.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pictures
import sculpture
from solids import Body, ball, grid, placed, turning
from surfaces import glossy, matte, mesh, panel, texture

M_PER_MM = 1e-3
WALL_Z = -1.5
SOFTBOX, WINDOW, ROOM = 7.5, 3.2, 0.14  # W m^-2 sr^-1
PARTS = ("head", "hair", "eye_left", "eye_right")


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng(int(params["shape_seed"]))
    features = sculpture.drawn(random)
    vertices, triangles = sculpture.head(features)
    tone, hair = float(params["skin"]), float(params["hair_tone"])
    skull = Body(vertices, triangles, pictures.unwound(vertices), np.full(len(vertices), tone))
    skin = texture(pictures.skin(tone, hair, features, random))
    iris = texture(pictures.eye(float(random.choice([0.05, 0.10, 0.18])), random))
    locks = texture(pictures.lock(hair, random), repeat=(1, 1))
    scene = {
        "head": mesh("head", _stood(skull, params), glossy(skin, 0.38, ior=1.4)),
        "hair": mesh("hair", _stood(sculpture.hair(params["hair"], random), params), glossy(locks, 0.30)),
    }
    for side, name in ((1, "eye_left"), (-1, "eye_right")):
        globe = ball(features.eye * (side, 1, 1), sculpture.EYE_R, rings=32, around=64)
        scene[name] = mesh(name, _stood(globe, params), glossy(iris, 0.06, ior=1.376))
    return scene | _shoulders(random, params) | _room(random) | _lights(params)


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """The head turns evenly by ``turn_deg`` in a second, and is at ``yaw_deg`` half way."""
    turn = float(params["turn_deg"]) / 2
    turning_ = {
        "axis": [0, 1, 0],
        "centre_m": [0, 0, float(params["nearer_m"])],
        "keyframes": [{"time_s": 0.0, "rotate_deg": -turn}, {"time_s": 1.0, "rotate_deg": turn}],
    }
    return dict.fromkeys(PARTS, turning_)


def _stood(body: Body, params: dict[str, Any]) -> Body:
    """From millimetres of the sculpture to the room: turned, and its chin a little up."""
    turn = turning([0, 1, 0], float(params["yaw_deg"])) @ turning([1, 0, 0], -2)
    return placed(body, (0, -0.004, float(params["nearer_m"])), turn=turn, scale=M_PER_MM)


def _shoulders(random: np.random.Generator, params: dict[str, Any]) -> dict[str, Any]:
    """A woollen jersey with its rolled collar."""
    angle = np.linspace(0, 2 * np.pi, 73)
    rings = [(0.060, 0.064, -0.128), (0.067, 0.071, -0.132), (0.070, 0.074, -0.142), (0.066, 0.070, -0.156)]
    rings += [(0.09, 0.080, -0.166), (0.16, 0.098, -0.187), (0.21, 0.108, -0.225), (0.24, 0.115, -0.36)]
    points = np.array([[(a * np.sin(t), y, b * np.cos(t)) for t in angle] for a, b, y in rings[::-1]])
    jersey = placed(grid(points), (0, 0, float(params["nearer_m"]) - 0.02))
    tone = float(random.choice([0.06, 0.16, 0.35, 0.55]))
    wool = texture(pictures.wool(tone, random), repeat=(2, 1))
    return {"jersey": mesh("jersey", jersey, matte(wool))}


def _room(random: np.random.Generator) -> dict[str, Any]:
    t = mi.ScalarTransform4f()
    side = float(random.choice([-1, 1]))
    return {
        "wall": {
            "type": "rectangle",
            "to_world": t.translate([0, 0.1, WALL_Z]).scale([1.2, 0.8, 1]),
            "bsdf": matte(texture(pictures.paper(random))),
        },
        "print": {
            "type": "rectangle",
            "to_world": t.translate([0.24 * side, 0.06, WALL_Z + 0.01]).scale([0.12, 0.16, 1]),
            "bsdf": matte(texture(pictures.framed(random))),
        },
    }


def _lights(params: dict[str, Any]) -> dict[str, Any]:
    side = -1 if params["softbox_side"] == "left" else 1
    return {
        "softbox": panel((0.95 * side, 0.55, 1.0), (0, 0, 0), (0.7, 0.7), SOFTBOX),
        "window": panel((-1.5 * side, 0.3, -0.1), (0, 0, 0), (1.0, 1.3), WINDOW),
        "room": {"type": "constant", "radiance": ROOM},
    }
