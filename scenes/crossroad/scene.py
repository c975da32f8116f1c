"""A model of a street crossing at 1:87, with traffic: built life-size, the card's unit scales it.

World frame: life-size metres, x right, y up, z towards the camera, which stands over the origin.
"""

from __future__ import annotations

from typing import Any

import movement
import sky
import town
import traffic

UNIT_M = 1 / 87  # metres of the model in a metre of the street; the card's unit_m


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (life-size metres, W m^-2 sr^-1) without sensor and integrator."""
    distance = _distance(params)
    scene: dict[str, Any] = {
        "sun": sky.sun(float(params["sun_azimuth_deg"])),
        "sky": sky.dome(int(params["seed"])),
        **town.town(distance, float(params["road_wear"]), int(params["seed"])),
    }
    return scene | movement.shapes(traffic.movers(params, distance), distance)


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """Keyframes of everybody who moves, in metres of the model."""
    words: dict[str, Any] = {}
    distance = _distance(params)
    for mover in traffic.movers(params, distance):
        words |= movement.motions(mover, distance, UNIT_M)
    return words


def _distance(params: dict[str, Any]) -> float:
    """Life-size metres from the camera to the middle of the main road."""
    return float(params["distance_m"]) / UNIT_M
