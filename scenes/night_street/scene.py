"""A night street after rain: an inn's lit sign in the middle depth, lamps, shops and cars far behind it.

World frame: metres, x right, y up; the camera stands over the right pavement, -z leads down the street.
"""

from __future__ import annotations

from typing import Any

import lights
import numpy as np
import sign
import street
import traffic
from meshes import glossy, joined, matte, mesh, tube

EYE = np.array([0.0, 3.0, 0.0])
AXIS = np.array([0.014, -0.021, -1.0]) / np.sqrt(1 + 0.014**2 + 0.021**2)
RIGHT = np.cross(AXIS, [0.0, 1.0, 0.0]) / np.linalg.norm(np.cross(AXIS, [0.0, 1.0, 0.0]))
UP = np.cross(RIGHT, AXIS)
SIGN_PLACE = (0.034, 0.001)  # of the sign's middle, right of the axis and above it, in shares of its distance
HEADLAMP, TAILLAMP = 60.0, 12.0  # W m^-2 sr^-1: about 400 cd a headlamp, 40 cd a tail-lamp


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng(int(params["seed"]))
    lacquer, plain = glossy(0.15), matte()
    bulbs, cable = lights.festoon()
    cars = traffic.cars(random)
    posts = street.lamp_posts(lights.POSTS, lights.GLOBE_HIGH)
    solid = street.fixtures(random) + traffic.people(random) + [tube(cable, 0.006)]
    scene: dict[str, Any] = {
        **_sign(params, random, lacquer, plain),
        **lights.globes(),
        **bulbs,
        **lights.windows(random),
        "sky": lights.sky(),
        "road": mesh("road", street.road(), street.wet_asphalt(float(params["wetness"]), random)),
        "pavements": mesh("pavements", street.pavements(), street.wet_slabs(random)),
        "fixtures": mesh("fixtures", joined(solid), plain),
        "posts": mesh("posts", joined(posts), lacquer),
        "cars": mesh("cars", joined([traffic.body(car) for car in cars]), lacquer),
    }
    for side, wall in zip(("right", "left"), street.walls(), strict=True):
        scene[f"wall_{side}"] = mesh(f"wall_{side}", wall, street.plaster(random, float(random.uniform(0.15, 0.4))))
    for car in cars:
        scene |= traffic.car_lamps(car, HEADLAMP, TAILLAMP)
    return scene


def _sign(params: dict[str, Any], random: np.random.Generator, lacquer: Any, plain: Any) -> dict[str, Any]:
    """The sign on its bracket, its lamps, and wet leaves close to the camera."""
    far, turn = float(params["distance_m"]), float(params["sign_turn_deg"])
    middle = EYE + far * (AXIS + SIGN_PLACE[0] * RIGHT + SIGN_PLACE[1] * UP)
    art = sign.picture(random, float(params["contrast"]))
    reach = (street.RIGHT_WALL - middle[0]) / np.cos(np.radians(turn)) + 0.05
    near = EYE + 2.55 * (AXIS - 0.052 * RIGHT - 0.062 * UP)
    return {
        "sign": mesh("sign", sign.board().moved(middle, turn), sign.paint(art)),
        "sign_frame": mesh("sign_frame", sign.frame().moved(middle, turn), lacquer),
        "ironwork": mesh("ironwork", sign.ironwork(float(reach)).moved(middle, turn), lacquer),
        "planter": mesh("planter", joined(street.planter(near, random)), plain),
        **sign.lamps(middle, turn, float(params["sign_lamp"])),
    }
