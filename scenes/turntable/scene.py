"""A painted jar turns slowly on a motor-driven stand whose rim has a scale; other pots stand behind it.

World frame: metres, x right, y up, z towards the lens; the table at y = -0.075. The lens
stands 0.14 m up at z = 0.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pottery
from solids import Body, box, grid, joined, placed, tube, turned, turning
from surfaces import cloudy, glossy, matte, mesh, noise, panel, texture, tones

TABLE_Y, PLATE_R, PLATE_Y = -0.075, 0.066, -0.048  # the plate's top is at PLATE_Y
WALL_Z = -1.1  # from the axis
LAMP_W, LAMP_M, WINDOW_W, ROOM_W = 9.0, (0.30, 0.30), 3.5, 0.28  # W m^-2 sr^-1
OTHERS = (("pitcher", -0.135, -0.24, 1.1), ("bowl", 0.135, -0.16, 1.0), ("amphora", 0.07, -0.50, 1.2))


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1817, int(params["seed"])])
    at = np.array([0.0, 0.0, -params["distance_m"]])
    start = turning([0, 1, 0], random.uniform(0, 360))
    foot = at + np.array([0.0, PLATE_Y, 0.0])
    body, handles = pottery.pot(params["form"])
    paint = pottery.painted(params["style"], random)
    glaze = glossy(texture(paint), params["gloss"])
    plain = mi.load_dict(matte(tones()))
    pots = []
    for form, x, z, size in OTHERS:
        shift = at + np.array([x + random.uniform(-0.01, 0.01), TABLE_Y, z + random.uniform(-0.02, 0.02)])
        turn = turning([0, 1, 0], random.uniform(0, 360))
        pots.append(placed(joined(list(pottery.pot(form))), shift, turn=turn, scale=size))
    other = glossy(texture(pottery.painted("light" if params["style"] == "dark" else "dark", random)), 0.3)
    return {
        "type": "scene",
        "jar": mesh("jar", placed(body, foot, turn=start), glaze),
        "handles": mesh("handles", placed(handles, foot, turn=start), plain),
        "plate": mesh("plate", placed(_disc(), foot, turn=start), matte(texture(pottery.scale_ring())), smooth=False),
        "rim": mesh("rim", placed(_rim(), foot, turn=start), plain),
        "motor": mesh("motor", placed(_motor(), at), plain, smooth=False),
        "pots": mesh("pots", joined(pots), other),
        **_room(at, random),
        **_lights(at, params["lamp_azimuth_deg"]),
    }


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """Jar and plate turn evenly; nothing is turned half way through the second."""
    half = params["turn_deg_per_s"] / 2
    turns = {
        "axis": [0.0, 1.0, 0.0],
        "centre_m": [0.0, 0.0, -params["distance_m"]],
        "keyframes": [{"time_s": 0.0, "rotate_deg": -half}, {"time_s": 1.0, "rotate_deg": half}],
    }
    return dict.fromkeys(("jar", "handles", "plate", "rim"), turns)


def _disc() -> Body:
    """The plate's top, on which the picture lies from above."""
    angle = np.linspace(0, 2 * np.pi, 181)
    rings = np.array([1.0, 0.5, 0.0])[:, None] * PLATE_R
    points = np.stack([rings * np.cos(angle), 0 * rings + 0 * angle, -rings * np.sin(angle)], axis=2)
    uv = np.stack([points[..., 0], -points[..., 2]], axis=2) / (2 * PLATE_R) + 0.5
    return grid(points, uv=uv)


def _rim() -> Body:
    """The plate's side, milled."""
    outline = [(PLATE_R, -0.009), (PLATE_R + 0.0006, -0.0085), (PLATE_R + 0.0006, -0.0008), (PLATE_R, 0.0)]
    side = turned(outline, around=360, tone=np.full((4, 1), 0.25))
    return side._replace(tone=np.where(np.arange(361) % 2, 0.10, 0.34)[None, :].repeat(4, axis=0).ravel())


def _motor() -> Body:
    """The stand's housing and its switch."""
    body = turned([(0.052, TABLE_Y), (0.052, PLATE_Y - 0.011), (0.0, PLATE_Y - 0.011)], around=120, tone=0.07)
    return joined([body, box([0.012, TABLE_Y + 0.004, 0.050], [0.022, TABLE_Y + 0.010, 0.056], tone=0.5)])


def _room(at: np.ndarray, random: np.random.Generator) -> dict[str, Any]:
    shape = (1000, 1000)
    cloth = 0.20 * (1 + 0.10 * noise(shape, (300, 300), random) + 0.08 * cloudy(shape, 12, 4, random))
    z = at[2]
    table = grid([[(x, TABLE_Y, z + far) for x in (-0.8, 0.8)] for far in (0.5, -0.8)])
    wall = 0.26 * (1 + 0.12 * cloudy((400, 700), 8, 5, random))
    pose = mi.ScalarTransform4f().translate([0, 0.2, z + WALL_Z]).scale([1.3, 0.6, 1])
    before = z + WALL_Z + 0.02
    ends = ([(x, -0.3, before), (x, 0.6, before)] for x in (-0.26, 0.05, 0.3))
    rails = [tube(np.array(pair), 0.008, tone=0.12) for pair in ends]
    return {
        "table": mesh("table", table, matte(texture(cloth, repeat=(2, 2))), smooth=False),
        "wall": {"type": "rectangle", "to_world": pose, "bsdf": matte(texture(wall))},
        "rails": mesh("rails", joined(rails), matte(tones())),
    }


def _lights(at: np.ndarray, azimuth_deg: float) -> dict[str, Any]:
    azimuth = np.radians(azimuth_deg)
    lamp = at + 0.75 * np.array([0.85 * np.sin(azimuth), 0.53, 0.85 * np.cos(azimuth)])
    window = at + np.array([-np.sign(azimuth) * 0.9, 0.35, 0.75])
    return {
        "lamp": panel(lamp, at, LAMP_M, LAMP_W),
        "window": panel(window, at, (0.8, 1.0), WINDOW_W),
        "room": {"type": "constant", "radiance": ROOM_W},
    }
