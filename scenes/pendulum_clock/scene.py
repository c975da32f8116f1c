"""A wall clock without its door: the pendulum swings behind the dial, before the back of the case.

World frame: metres, x right, y up, z towards the lens, which stands at the origin and looks along -z. The
clock's own frame is in millimetres: the bob hangs at its origin when at rest.
"""

from __future__ import annotations

from typing import Any

import clockwork as clock
import mitsuba as mi
import numpy as np
from solids import Body, box, joined, placed, turning
from surfaces import glossy, matte, mesh, panel, texture

M_PER_MM = 1e-3
BOB_DOWN_MM, LENGTH_MM = 14.0, 200.0  # of the bob under the middle of the picture; its pendulum
DIAL_MM, DIAL_Z, DIAL_Y = 88.0, 62.0, 152.0
CASE_MM, BACK_Z = (330.0, 560.0), -58.0
BRASS, STEEL = 0.60, 0.34  # reflectances of lacquered brass and of blued steel, both brushed
ROUGH = 0.34
G = 9.81  # m s^-2
KNOTS = 61
LAMP, WINDOW, ROOM = 14.0, 3.6, 0.12  # W m^-2 sr^-1


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1657, int(params["seed"])])
    tone = float(params["wood"])
    radius = float(params["bob_mm"])
    engraved = BRASS * clock.engraved(str(params["bob"]), radius, random)
    finishes = {
        "bob": glossy(texture(np.clip(engraved, 0.05, 0.75)), ROUGH),
        "steel": glossy(STEEL, ROUGH),
        "brass": glossy(BRASS, ROUGH),
        "tip": glossy(BRASS, ROUGH),
        "wood": glossy(texture(clock.wood((600, 40), 0.30, random)), 0.3),
    }
    bodies = {"bob": clock.bob(radius), **clock.rods(str(params["rod"]), LENGTH_MM, radius)}
    scene = {name: _placed(name, body, params, finishes[name]) for name, body in bodies.items()}
    still = {
        "dial": (clock.disc(DIAL_MM), matte(texture(clock.dial(DIAL_MM, random)))),
        "bezel": (clock.bezel(DIAL_MM), glossy(BRASS, ROUGH)),
    }
    for name, (body, bsdf) in still.items():
        scene[name] = _placed(name, placed(body, (0, DIAL_Y, DIAL_Z)), params, bsdf)
    beats = placed(clock.plate(120, 18, -14), (0, -radius - 30, 0))
    scene["scale"] = _placed("scale", beats, params, matte(texture(clock.scale(random))))
    return scene | _case(params, tone, random) | _lights(params)


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """The pendulum swings about its suspension, as long as a simple one of its length takes."""
    turn, shift = _pose(params)
    times = np.linspace(0, 1, KNOTS)
    period = 2 * np.pi * np.sqrt(LENGTH_MM * M_PER_MM / G)
    angles = params["swing_deg"] * np.sin(2 * np.pi * (times / period + params["phase"]))
    swing = {
        "axis": turn[:, 2].tolist(),
        "centre_m": (turn @ [0.0, LENGTH_MM * M_PER_MM, 0.0] + shift).tolist(),
        "keyframes": [{"time_s": float(t), "rotate_deg": float(a)} for t, a in zip(times, angles, strict=True)],
    }
    return dict.fromkeys(["bob", "tip", *(("wood",) if params["rod"] == "wood" else ("steel", "brass"))], swing)


def _pose(params: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and shift (m) from the clock to the world."""
    shift = np.array([0.0, -BOB_DOWN_MM * M_PER_MM, -params["distance_m"]])
    return turning([0, 1, 0], params["yaw_deg"]), shift


def _placed(name: str, body: Body, params: dict[str, Any], bsdf: Any) -> mi.Mesh:
    turn, shift = _pose(params)
    return mesh(name, placed(body, shift, turn=turn, scale=M_PER_MM), bsdf)


def _case(params: dict[str, Any], tone: float, random: np.random.Generator) -> dict[str, Any]:
    """The back of the case, its sides with a moulding, and the papered wall round it."""
    wide, high = CASE_MM
    back = placed(clock.plate(wide, high, BACK_Z), (0, 60, 0))
    sides = []
    for side in (-1, 1):
        x = sorted((side * wide / 2, side * (wide / 2 + 22)))
        sides += [box((x[0], -260, BACK_Z), (x[1], 360, 74)), box((x[0] - 5, -260, 74), (x[1] + 5, 360, 82))]
    grain = clock.wood((900, 600), tone, random)
    wall = placed(clock.plate(1600, 1200, BACK_Z - 12), (0, 60, 0))
    return {
        "back": _placed("back", back, params, glossy(texture(1.3 * grain), 0.3)),
        "sides": mesh("sides", _world(joined(sides), params), glossy(texture(grain), 0.3), smooth=False),
        "wall": _placed("wall", wall, params, matte(0.35)),
    }


def _world(body: Body, params: dict[str, Any]) -> Body:
    turn, shift = _pose(params)
    return placed(body, shift, turn=turn, scale=M_PER_MM)


def _lights(params: dict[str, Any]) -> dict[str, Any]:
    a, far = np.radians(float(params["lamp_azimuth_deg"])), float(params["distance_m"])
    middle = np.array([0.0, 0.0, -far])
    return {
        "lamp": panel(middle + np.array([1.1 * np.sin(a), 0.25, 1.1 * np.cos(a)]), middle, (0.35, 0.5), LAMP),
        "window": panel(middle + np.array([-1.0 * np.sign(a), -0.1, 1.3]), middle, (0.7, 1.0), WINDOW),
        "room": {"type": "constant", "radiance": ROOM},
    }
