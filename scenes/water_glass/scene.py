"""A printed tumbler of sparkling water with a straw, drops on it, on a checked cloth before a window.

World frame: millimetres, x right, y up, z towards the lens, looking down by 6 degrees; the cloth is y = 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import prints
import wet
from solids import Body, grid, placed, tube, turned
from surfaces import cloudy, matte, mesh, noise, panel, texture, tones

BASE_MM, RIM_MM = 7.0, 104.0
WATER, GLASS = 1.33, 1.5
FILM_MM = 0.15  # of air, between what lies on the wall and the wall; Mitsuba's rays start 0.09 units off a surface
WINDOW_Z, WINDOW_MM = -330.0, (900.0, 560.0)
WINDOW, LAMP, ROOM = 3.2, 2.4, 0.2  # W m^-2 sr^-1
SELDOM = 0.1  # rays towards the room, which chance finds often enough


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (millimetres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([733, int(params["seed"])])
    radius, level = float(params["radius_mm"]), float(params["level_mm"])
    at = np.array([0.0, 0.0, float(params["nearer_mm"])])
    ink, printed = prints.enamel(params["design"], radius + FILM_MM, random)
    drops = wet.drops(int(params["drops"]), radius + FILM_MM, level, ink, random)
    bubbles = wet.bubbles(int(params["bubbles"]), radius, (BASE_MM, level), random)
    scene = {
        "type": "scene",
        "print": mesh("print", placed(printed, at), matte(tones()), smooth=False),
        "drops": mesh("drops", placed(drops, at), clear(WATER)),
        "bubbles": mesh("bubbles", placed(bubbles, at), clear(1.0, WATER)),
        "straw": mesh("straw", placed(_straw(radius, float(params["straw_deg"])), at), _steel()),
    }
    for name, (body, bsdf) in _tumbler(radius, level).items():
        scene[name] = mesh(name, placed(body, at), bsdf)
    cloth = grid([[(-600, 0, 260), (600, 0, 260)], [(-600, 0, WINDOW_Z), (600, 0, WINDOW_Z)]])
    scene["cloth"] = mesh("cloth", cloth, matte(texture(_cloth(random))), smooth=False)
    return scene | _lights(int(params["lamp_side"]), random)


def clear(inside: float, outside: float = 1.0) -> dict[str, Any]:
    """A smooth surface between two clear substances of these indices."""
    return {"type": "dielectric", "int_ior": inside, "ext_ior": outside}


def _tumbler(radius: float, level: float) -> dict[str, tuple[Body, dict[str, Any]]]:
    """Base and rim of glass, the thin wall above the water, and the water, whose surface climbs the wall."""
    crest = level + 1.6
    base = [(0, 0.2), (radius - 1.5, 0.2), (radius, 1.4), (radius, BASE_MM - 0.2)]
    ring = [(radius + 0.8 * np.sin(a), RIM_MM - 0.8 * np.cos(a)) for a in np.linspace(0, 2 * np.pi, 13)]
    top = [(radius, crest), (radius - 0.5, level + 0.75), (radius - 1.6, level + 0.2), (radius - 4, level), (0, level)]
    parts = {
        "base": (turned(base, around=192), clear(GLASS)),
        "base_top": (turned([(radius, BASE_MM - 0.2), (0, BASE_MM - 0.2)], around=192), clear(GLASS)),
        "water_foot": (turned([(0, BASE_MM), (radius, BASE_MM)], around=192), clear(WATER)),
        "water_side": (turned([(radius, BASE_MM), (radius, crest)], around=192), clear(WATER)),
        "water_top": (turned(top, around=192), clear(WATER)),
        "wall": (turned([(radius, crest), (radius, RIM_MM)], around=192), {"type": "thindielectric"}),
        "rim": (turned(ring, around=192), clear(GLASS)),
    }
    return parts


def _straw(radius: float, lean_deg: float) -> Body:
    """From the base, where it rests against the wall, up over the rim."""
    foot = np.array([-np.sign(lean_deg) * (radius - 8), BASE_MM + 4, -4.0])
    way = np.array([np.sin(np.radians(lean_deg)), np.cos(np.radians(lean_deg)), -0.05])
    return tube(foot + np.linspace(0, 150, 12)[:, None] * way, 2.6, around=40)


def _steel() -> dict[str, Any]:
    """Brushed stainless steel; principled, whose light paths share what they find."""
    return {"type": "twosided", "bsdf": {"type": "principled", "metallic": 1.0, "base_color": 0.58, "roughness": 0.15}}


def _cloth(random: np.random.Generator) -> np.ndarray:
    """A cloth woven in checks of 18 mm, 1.2 m × 0.59 m, its threads left out."""
    rows, columns = 984, 2000
    y, x = np.mgrid[0:rows, 0:columns] * 0.6
    grey = 0.30 - 0.11 * (np.mod((x + 9) / 36, 1) < 0.5) - 0.11 * (np.mod(y / 36, 1) < 0.5)
    return np.clip(grey * (1 + 0.05 * noise((rows, columns), (rows / 3, columns / 3), random)), 0.05, 0.8)


def _window_picture(random: np.random.Generator) -> np.ndarray:
    """Sky over a line of trees, unsharp as far things are, between bars and a frame; relative radiance."""
    rows, columns = 280, 450
    y, x = np.mgrid[0:rows, 0:columns]
    x, y = x / columns, 1 - y / rows
    trees = 0.33 + 0.10 * cloudy((rows, columns), 5, 2, random)[rows // 2]
    sky = 0.75 + 0.25 * y + 0.08 * cloudy((rows, columns), 3, 2, random)
    low = 0.20 + 0.10 * cloudy((rows, columns), 14, 2, random)
    share = np.clip((y - trees) / 0.06 + 0.5, 0, 1)
    grey = low + share * (sky - low)
    for bar in (0.26, 0.5, 0.74):
        grey *= 1 - 0.92 * np.clip((0.024 - np.abs(x - bar)) / 0.012, 0, 1)
    grey *= 1 - 0.92 * np.clip((0.026 - np.abs(y - 0.58)) / 0.013, 0, 1)
    return np.clip(grey, 0.02, 1.2).astype(np.float32)


def _lights(side: int, random: np.random.Generator) -> dict[str, Any]:
    """The window behind, a broad lamp before it to one side, the room."""
    window = panel((0, 215, WINDOW_Z), (0, 215, 0), WINDOW_MM, 1.0)
    window["emitter"] = {"type": "area", "radiance": texture(WINDOW * _window_picture(random))}
    return {
        "window": window,
        "lamp": panel((side * 380, 420, 420), (0, 45, 30), (620, 620), LAMP),
        "room": {"type": "constant", "radiance": ROOM, "sampling_weight": SELDOM},
    }
