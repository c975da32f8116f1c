"""An embroidered cloth that hangs from a rod and sways in a draught, with a fringe, before a dim room.

World frame: metres, x right, y up, z towards the lens, which stands at the origin and looks along -z.
"""

from __future__ import annotations

from typing import Any

import cloth
import mitsuba as mi
import numpy as np
from solids import Body, ball, grid, joined, placed, tube, turned, turning
from surfaces import cloudy, glossy, matte, mesh, panel, texture, tones

WIDE_M, HIGH_M = cloth.SIZE_MM[0] * 1e-3, cloth.SIZE_MM[1] * 1e-3
HEM_Y, CELLS = -0.027, (90, 130)  # lower edge of the cloth; quadrilaterals down and across
ROD_Y = HEM_Y + HIGH_M + 0.01  # the cloth swings about it
FRINGE_M, TASSEL_MM = 0.030, 2.4
WALL_M = -1.5
LAMP_AWAY_M, LAMP_M, LAMP_IRRADIANCE = (0.60, 0.35), (0.28, 0.28), 2.4  # aside, up; W m^-2 on the cloth
WINDOW_RADIANCE, ROOM_RADIANCE = 5.0, 0.2  # W m^-2 sr^-1
KNOTS, SWINGS = 21, 0.75  # keyframes; swings in a second


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1801, int(params["seed"])])
    heights = _folds(params["fold_mm"] * 1e-3, random)
    picture = texture(cloth.picture(params, random))
    return {
        "type": "scene",
        "cloth": _placed("cloth", _sheet(heights), params, matte(picture)),
        "fringe": _placed("fringe", _fringe(heights, params, random), params, matte(tones())),
        **_room(random),
        **_lights(params),
    }


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """The cloth swings about its rod, and goes a little to and fro along it."""
    random = np.random.default_rng([1802, int(params["seed"])])
    phases = random.uniform(0, 2 * np.pi, 2)
    turn, shift = _pose(params)
    times = np.linspace(0, 1, KNOTS)

    def wave(phase: float, swings: float) -> np.ndarray:
        return np.sin(2 * np.pi * swings * (times - 0.5) + phase) - np.sin(phase)  # at rest half way

    aside = params["sway_mm"] * 1e-3 * wave(phases[0], SWINGS)[:, None] * turn[:, 0]
    swung = params["sway_mm"] * wave(phases[1], 0.8 * SWINGS)
    keyframes = [
        {"time_s": float(t), "translate_m": a.tolist(), "rotate_deg": float(s)}
        for t, a, s in zip(times, aside, swung, strict=True)
    ]
    swing = {
        "axis": turn[:, 0].tolist(),
        "centre_m": (turn @ [0.0, ROD_Y, 0.0] + shift).tolist(),
        "keyframes": keyframes,
    }
    return {"cloth": swing, "fringe": swing}


def _pose(params: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and shift (m) from the cloth to the world."""
    return turning([0, 1, 0], params["yaw_deg"]), np.array([0.0, 0.0, -params["distance_m"]])


def _placed(name: str, body: Body, params: dict[str, Any], bsdf: Any) -> mi.Mesh:
    turn, shift = _pose(params)
    return mesh(name, placed(body, shift, turn=turn), bsdf)


def _folds(high: float, random: np.random.Generator) -> np.ndarray:
    """How far the cloth stands out (m) on a grid, row 0 at the hem: folds that open downwards."""
    v, u = np.meshgrid(np.linspace(0, 1, CELLS[0] + 1), np.linspace(0, 1, CELLS[1] + 1), indexing="ij")
    made = np.zeros_like(u)
    for count, share in ((2.3, 0.5), (4.1, 0.35), (7.3, 0.15)):
        lean, phase = random.uniform(-0.15, 0.15), random.uniform(0, 2 * np.pi)
        made += share * np.sin(2 * np.pi * count * (u + lean * v) + phase)
    return high * made * (0.6 + 0.4 * (1 - v))


def _sheet(heights: np.ndarray) -> Body:
    v, u = np.meshgrid(np.linspace(0, 1, CELLS[0] + 1), np.linspace(0, 1, CELLS[1] + 1), indexing="ij")
    points = np.stack([(u - 0.5) * WIDE_M, HEM_Y + v * HIGH_M, heights], axis=2)
    return grid(points, uv=np.stack([u, v], axis=2))


def _fringe(heights: np.ndarray, params: dict[str, Any], random: np.random.Generator) -> Body:
    """Knotted tassels along the hem, each of some threads."""
    made = []
    for x in np.arange(-0.49 * WIDE_M, 0.49 * WIDE_M, TASSEL_MM * 1e-3):
        z = float(np.interp(x / WIDE_M + 0.5, np.linspace(0, 1, heights.shape[1]), heights[0]))
        tone = params["ground"] * random.uniform(0.8, 1.0)
        knot = [x + random.normal(0, 1.5e-4), HEM_Y - 0.0045, z]
        made.append(ball(knot, [0.9e-3, 1.1e-3, 0.9e-3], rings=6, around=8, tone=tone))
        for _ in range(3):
            lean = random.normal(0, [0.9e-3, 0.9e-3], 2)
            share = np.linspace(0, 1, 7)[:, None]
            length = FRINGE_M * random.uniform(0.75, 1.0)
            bend = 4e-4 * np.sin(5 * share + random.uniform(0, 6))
            path = np.array(knot) + share * [lean[0], -length, lean[1]] + bend * [1, 0, 0.5]
            made.append(tube(path, 3.2e-4, around=5, tone=tone * random.uniform(0.75, 1.1)))
        path = np.array([[x, HEM_Y + 5e-4, z + 2e-4], knot])
        made.append(tube(path, 5e-4, around=5, tone=tone))
    return joined(made)


def _room(random: np.random.Generator) -> dict[str, Any]:
    """A wall with a picture rail, a table with two jars far behind."""
    t = mi.ScalarTransform4f()
    wall = 0.22 * (1 + 0.15 * cloudy((400, 700), 8, 5, random))
    wall[330:] *= 0.45
    back = t.translate([0, 0, WALL_M]).scale([1.2, 0.8, 1])
    outline = [(0.0, 0.0), (0.05, 0.0), (0.075, 0.05), (0.07, 0.11), (0.03, 0.14), (0.036, 0.16)]
    jar = turned(outline, around=48)
    jars = joined([placed(jar, [x, -0.26, -1.3], scale=s) for x, s in ((-0.14, 1.0), (0.11, 0.8))])
    return {
        "wall": {"type": "rectangle", "to_world": back, "bsdf": matte(texture(wall))},
        "jars": mesh("jars", jars, glossy(0.3, 0.3)),
    }


def _lights(params: dict[str, Any]) -> dict[str, Any]:
    middle = np.array([0.0, 0.0, -params["distance_m"]])
    azimuth = np.radians(params["lamp_azimuth_deg"])
    aside, up = LAMP_AWAY_M
    away = np.array([aside * np.sin(azimuth), up, aside * np.cos(azimuth)])
    cosine = away[2] / np.linalg.norm(away)
    radiance = LAMP_IRRADIANCE * (away @ away) / (LAMP_M[0] * LAMP_M[1] * cosine)
    window = (-np.sign(params["lamp_azimuth_deg"]) * 0.8, 0.3, 0.2)
    return {
        "lamp": panel(middle + away, middle, LAMP_M, float(radiance)),
        "window": panel(window, middle, (0.7, 1.0), WINDOW_RADIANCE),
        "room": {"type": "constant", "radiance": ROOM_RADIANCE},
    }
