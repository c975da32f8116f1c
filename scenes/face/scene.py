"""Somebody's head and shoulders in a room; they turn slowly.

World frame: metres, x right, y up, z towards the lens, which stands at z = 2.2; the eyes are near y = 0.
"""

from __future__ import annotations

from typing import Any

import clothes
import hair
import numpy as np
import person
import skin
from knit import LOOPS, stitch
from living_room import room
from solids import Body, grid, placed, turning
from surfaces import matte, mesh, panel, texture, tones

M_PER_MM = 1e-3
WALL_Z = -1.75
SOFTBOX, WINDOW, ROOM = 9.0, 3.0, 0.10  # W m^-2 sr^-1
TARGET = ("head", "hair", "brows", "lashes", "eye_left", "eye_right")
PARTS = (*TARGET, "pullover", "band")
IRIS, CORNEA_MM = 0.48, 1.1  # rad off the axis at which the cornea begins; how far it stands out


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([2607, int(params["shape_seed"])])
    tone, dark = float(params["skin"]), float(params["hair_tone"])
    sitter = person.drawn(params, random)
    looks = skin.skin(tone, dark, sitter, random)
    head = Body(
        sitter.vertices, sitter.mesh.triangles, skin.unwound(sitter.vertices), np.full(len(sitter.vertices), tone)
    )
    iris = _eye(float(random.choice([0.015, 0.025, 0.04, 0.07])), random)
    strands = _strands()
    made = {
        "head": (head, _skin(looks)),
        "hair": (hair.head_hair(str(params["hair"]), dark, sitter, random), strands),
        "brows": (hair.brows(min(dark, 0.6 * tone), sitter, random), strands),
        "lashes": (hair.lashes(dark, sitter, random), strands),
    }
    for name, middle in zip(("eye_left", "eye_right"), sitter.eyes, strict=True):
        made[name] = (_eyeball(middle, sitter.eye_r, params), iris)
    knit = float(random.choice([0.05, 0.12, 0.3, 0.5]))
    wool = matte(texture(stitch(knit, random), repeat=(1 / LOOPS[0], 1 / LOOPS[1])))
    made |= {name: (cloth, wool) for name, cloth in clothes.pullover(sitter).items()}
    scene = {name: mesh(name, _stood(body, params), look) for name, (body, look) in made.items()}
    return scene | room(random, wall_z=WALL_Z) | _lights(params)


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """The sitter turns evenly by ``turn_deg`` in a second, and is at ``yaw_deg`` half way."""
    turn = float(params["turn_deg"]) / 2
    turning_ = {
        "axis": [0, 1, 0],
        "centre_m": [0, 0, float(params["nearer_m"]) + person.SKULL[2] * M_PER_MM],
        "keyframes": [{"time_s": 0.0, "rotate_deg": -turn}, {"time_s": 1.0, "rotate_deg": turn}],
    }
    return dict.fromkeys(PARTS, turning_)


def _stood(body: Any, params: dict[str, Any]) -> Body:
    """From millimetres of the sitter to the room, turned about the neck."""
    turn = turning([0, 1, 0], float(params["yaw_deg"])) @ turning([0, 0, 1], float(params["tilt_deg"]))
    axis = np.array([0, 0, person.SKULL[2]])
    shift = M_PER_MM * (axis - turn @ axis) + [0, 0, float(params["nearer_m"])]
    return placed(Body(*body), shift, turn=turn, scale=M_PER_MM)


def _skin(looks: skin.Skin) -> dict[str, Any]:
    """A rough coat of index 1.4 over a ground, with pores and lines as relief."""
    coat = {
        "type": "principled",
        "base_color": texture(looks.grey),
        "roughness": texture(looks.rough),
        "eta": 1.4,
        "flatness": 0.5,
        "sheen": 0.15,
    }
    return {"type": "bumpmap", "relief": texture(looks.relief), "bsdf": coat}


def _strands() -> dict[str, Any]:
    return {"type": "principled", "base_color": tones(), "roughness": 0.34, "eta": 1.55}


def _eye(tone: float, random: np.random.Generator) -> dict[str, Any]:
    coat = {"type": "roughplastic", "alpha": 0.05, "int_ior": 1.376}
    return coat | {"diffuse_reflectance": texture(skin.eye(tone, random), repeat=(1, 1))}


def _eyeball(middle: np.ndarray, radius: float, params: dict[str, Any]) -> Body:
    """A ball with its cornea, its axis towards the lens as far as an eye likes to turn."""
    off = np.linspace(np.pi, 0, 121)[:, None]
    around = np.linspace(0, 2 * np.pi, 65)
    r = radius + CORNEA_MM * np.clip(1 - (off / IRIS) ** 2, 0, 1)
    points = np.stack(
        np.broadcast_arrays(r * np.sin(off) * np.cos(around), r * np.sin(off) * np.sin(around), r * np.cos(off)), axis=2
    )
    gaze = turning([0, 1, 0], -float(np.clip(0.8 * float(params["yaw_deg"]), -16, 16))) @ turning([1, 0, 0], 1.5)
    return placed(grid(points), middle, turn=gaze)


def _lights(params: dict[str, Any]) -> dict[str, Any]:
    side = -1 if params["softbox_side"] == "left" else 1
    return {
        "softbox": panel((1.0 * side, 0.6, 1.15), (0, 0, 0), (0.8, 0.8), SOFTBOX),
        "window": panel((-1.5 * side, 0.3, -0.1), (0, 0, 0), (1.0, 1.3), WINDOW),
        "room": {"type": "constant", "radiance": ROOM},
    }
