"""A small travel poster on a table before a city map pinned to a brick wall: two detailed planes.

World frame: metres, x right, y up, z towards the lens, which stands at the origin and looks along -z.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from citymap import HEIGHT_MM as MAP_HEIGHT_MM
from citymap import WIDTH_MM as MAP_WIDTH_MM
from citymap import citymap
from patterns import bricks, pencil, planks
from poster import HEIGHT_MM, WIDTH_MM, poster
from shapes import box, matte, panel, placed, radiance_for, satin, sheet, turned

X, Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
M_PER_MM = 1e-3
POSTER_TEXEL_MM, MAP_TEXEL_MM = 0.085, 0.22  # a pixel sees 0.34 mm at 0.45 m and 0.70 mm at 0.9 m
POSTER_AT = (0.032, 0.002)  # its middle: beside the axis, and above it
TABLE_Y, FOOT_M = -0.040, 0.004  # table top, and how deep the poster stands in its foot
TABLE_END_M = 0.10  # from the table's far edge to the wall
WALL_BEHIND_M = 0.002  # map to wall
MAP_AT = (0.085, 0.112)

# Outline of a pencil: radius and height (m) from the blunt end to the lead.
PENCIL = [(0.0, 0.0), (0.0037, 0.0002), (0.0037, 0.07), (0.0037, 0.098), (0.0010, 0.115), (0.0, 0.119)]

LAMP_SIZE, LAMP_AWAY, LAMP_UP = (0.2, 0.2), 0.85, 0.45
WINDOW_SIZE = (0.9, 1.2)
LAMP_IRRADIANCE, WINDOW_RADIANCE = 1.25, 6.5  # W m^-2 on the target; W m^-2 sr^-1


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator.

    ``target`` says which of poster (near) and map (far) is `target_plane`; the other is `other_plane`.
    """
    near, far = params["near_m"], params["far_m"]
    side = {"left": -1.0, "right": 1.0}[params["near_side"]]
    random = np.random.default_rng([51, params["print_seed"]])
    card = side * POSTER_AT[0], POSTER_AT[1], -near
    plan = -side * MAP_AT[0], MAP_AT[1], -far
    lean = (X, -3.0), (Y, params["near_yaw_deg"])
    face = satin(poster(POSTER_TEXEL_MM, random), 0.3)
    planes = {
        "near": sheet(placed(card, *lean), WIDTH_MM * M_PER_MM, HEIGHT_MM * M_PER_MM, face),
        "far": sheet(
            placed(plan), MAP_WIDTH_MM * M_PER_MM, MAP_HEIGHT_MM * M_PER_MM, matte(citymap(MAP_TEXEL_MM, random))
        ),
    }
    chosen = params["target"]
    other = {"near": "far", "far": "near"}[chosen]
    return {
        "type": "scene",
        "target_plane": planes[chosen],
        "other_plane": planes[other],
        **_lights(params["lamp_azimuth_deg"], side, card if chosen == "near" else (0.0, 0.0, -far)),
        **_room(far),
        **_small_things(card, plan, side, params["near_yaw_deg"]),
    }


def _lights(azimuth_deg: float, side: float, target: tuple[float, float, float]) -> dict[str, Any]:
    """Desk lamp, set to give the target the same light from any side; a window opposite the poster."""
    azimuth = np.radians(azimuth_deg)
    lamp = (target[0] + LAMP_AWAY * np.sin(azimuth), target[1] + LAMP_UP, target[2] + LAMP_AWAY * np.cos(azimuth))
    radiance = radiance_for(LAMP_IRRADIANCE, lamp, LAMP_SIZE, target, (0.0, 0.0, 1.0))
    window = -side * 1.25, 0.65, 0.25
    return {
        "lamp": panel(lamp, target, LAMP_SIZE, radiance),
        "window": panel(window, (0.0, 0.0, -0.65), WINDOW_SIZE, WINDOW_RADIANCE),
    }


def _room(far: float) -> dict[str, Any]:
    random = np.random.default_rng(52)
    edge, front = far - TABLE_END_M, 0.18
    wood = satin(planks((1500, 1700), 8, random), 0.35)
    top = placed((0.0, TABLE_Y, -(front + edge) / 2), (X, -90.0))
    middle = 0.0, 0.06, -far - WALL_BEHIND_M
    ceiling = placed((0.0, 1.6, 0.2), (X, 90.0))
    return {
        "ceiling": sheet(ceiling, 3.0, 3.0, matte(0.8)),
        "table": sheet(top, 0.66, edge - front, wood),
        "wall": sheet(placed(middle), 0.68, 0.50, matte(bricks(0.68, 0.50, 0.0004, random))),
    }


def _small_things(card: Any, plan: Any, side: float, yaw_deg: float) -> dict[str, Any]:
    """Foot of the poster, pins of the map, and a pencil between the two planes."""
    random = np.random.default_rng(53)
    foot = planks((160, 560), 1, random)
    x, _, z = card
    height = POSTER_AT[1] - HEIGHT_MM / 2 * M_PER_MM + FOOT_M - TABLE_Y
    block = placed((x, TABLE_Y + height / 2, z), (Y, yaw_deg))
    things = {"foot": box(block, (0.052, height, 0.014), satin(1.6 * foot, 0.3))}
    pin = satin(0.07, 0.3)
    for number, (across, up) in enumerate([(-1, 1), (1, 1), (-1, -1), (1, -1)]):
        at = [
            plan[0] + across * (MAP_WIDTH_MM / 2 - 5) * M_PER_MM,
            plan[1] + up * (MAP_HEIGHT_MM / 2 - 5) * M_PER_MM,
            plan[2] + 0.003,
        ]
        things[f"pin_{number}"] = {"type": "sphere", "center": at, "radius": 0.0042, "bsdf": pin}
    lying = placed((-side * 0.062, TABLE_Y + PENCIL[1][0], -0.60), (Y, side * 62.0), (X, 90.0))
    things["pencil"] = turned("pencil", PENCIL, lying, satin(pencil(random), 0.35))
    return things
