"""A small desk fan that runs down before a wall with a calendar: a wire guard, and blades 30 mm behind it.

World frame: metres, x right, y up, z towards the lens, which stands at the origin and looks along -z.
"""

from __future__ import annotations

from typing import Any

import machine
import mitsuba as mi
import numpy as np
import prints
from meshes import box, matte, mesh, panel, satin, sheet

AXLE_Y, DESK_Y = 0.005, -0.0545
WALL_Z, DESK_NEAR_Z = -1.26, -0.50

SLOWING = 0.3  # rev/s lost in a second: what the bearings of a small fan brake
KNOTS = 21  # keyframes; the angle is off its parabola by 0.04 degrees at most
TURN_DEG = 360.0

LAMP_SIZE, LAMP_AWAY, LAMP_UP = (0.24, 0.24), 0.75, 0.42
LAMP_IRRADIANCE, WINDOW_RADIANCE, SKY_RADIANCE = 2.2, 5.5, 0.16  # W m^-2 on the fan; W m^-2 sr^-1


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator.

    ``target`` says which of guard and blades is `target_body` with `target_hub`; the other is `other_...`.
    """
    random = np.random.default_rng([71, params["wear_seed"]])
    pose = _pose(params)
    guard, rotor = machine.guard(params, random, pose), machine.rotor(params, random, pose)
    wanted, left = (guard, rotor) if params["target"] == "guard" else (rotor, guard)
    return {
        "type": "scene",
        **_named("target", wanted),
        **_named("other", left),
        **machine.stand(random, pose, AXLE_Y - DESK_Y),
        **_room(random),
        **_lights(params),
    }


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """The rotor runs down: ``rev_per_s`` half way through the second, a little more before, less after."""
    times = np.linspace(0, 1, KNOTS)
    late = times - 0.5
    degrees = TURN_DEG * (params["rev_per_s"] * late - SLOWING / 2 * late**2)
    pose = np.array(_pose(params).matrix, dtype=float)
    turning = {
        "axis": pose[:3, 2].tolist(),
        "centre_m": pose[:3, 3].tolist(),
        "keyframes": [{"time_s": float(t), "rotate_deg": float(a)} for t, a in zip(times, degrees, strict=True)],
    }
    which = "target" if params["target"] == "blades" else "other"
    return {f"{which}_body": turning, f"{which}_hub": turning}


def _pose(params: dict[str, Any]) -> Any:
    """From the fan's frame to the world: the middle of the guard's face ``distance_m`` from the lens."""
    pose = mi.ScalarTransform4f().translate([0.0, AXLE_Y, -params["distance_m"]])
    return pose @ mi.ScalarTransform4f().rotate([0, 1, 0], params["yaw_deg"])


def _named(role: str, parts: tuple[Any, Any]) -> dict[str, Any]:
    names = f"{role}_body", f"{role}_hub"
    return {name: mesh(name, *part) for name, part in zip(names, parts, strict=True)}


def _room(random: np.random.Generator) -> dict[str, Any]:
    t = mi.ScalarTransform4f()
    depth = DESK_NEAR_Z - WALL_Z
    flat = t.translate([0, DESK_Y, (DESK_NEAR_Z + WALL_Z) / 2]).rotate([1, 0, 0], -90)
    wide, high = (side * 1e-3 for side in prints.CALENDAR_MM)
    room = {
        "desk": sheet(flat, 0.9, depth, satin(prints.desk((1500, 1600), 9, random), 0.35)),
        "wall": sheet(t.translate([0, 0.1, WALL_Z]), 0.9, 0.5, matte(prints.wall((900, 1600), random))),
        "calendar": sheet(
            t.translate([0.082, 0.048, WALL_Z + 0.003]).rotate([0, 0, 1], -1.5),
            wide,
            high,
            matte(prints.calendar(random)),
        ),
    }
    lying = [(0.215, 0.030, 0.15, 0.10, 0.62, "TIDES AND WINDS", 4.0), (0.190, 0.022, 0.14, 0.52, 0.06, "OPTICS", -7.0)]
    low = DESK_Y
    for number, (length, thick, deep, ground, ink, title, yaw) in enumerate(lying):
        middle = t.translate([-0.135, low + thick / 2, -1.12]).rotate([0, 1, 0], yaw)
        cover = matte(prints.spine(ground, ink, title, random))
        room[f"book_{number}"] = box(middle, (length, thick, deep), cover)
        low += thick
    return room


def _lights(params: dict[str, Any]) -> dict[str, Any]:
    """A desk lamp that gives the fan the same light from any side; a window and what the room returns."""
    fan = np.array([0.0, AXLE_Y, -params["distance_m"]])
    azimuth = np.radians(params["lamp_azimuth_deg"])
    away = np.array([LAMP_AWAY * np.sin(azimuth), LAMP_UP, LAMP_AWAY * np.cos(azimuth)])
    distance = np.linalg.norm(away)
    cosine = away[2] / distance
    radiance = LAMP_IRRADIANCE * distance**2 / (LAMP_SIZE[0] * LAMP_SIZE[1] * cosine)
    window = (-np.sign(params["lamp_azimuth_deg"]) * 1.1, 0.55, -0.25)
    return {
        "lamp": panel(fan + away, fan, LAMP_SIZE, float(radiance)),
        "window": panel(window, fan, (0.8, 1.1), WINDOW_RADIANCE),
        "sky": {"type": "constant", "radiance": SKY_RADIANCE},
    }
