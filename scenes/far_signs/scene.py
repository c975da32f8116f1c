"""A station yard through a long lens: a sign on posts, a clock and a parked car behind it, posters on a wall.

World frame: metres, x right, y up; the lens stands 2.6 m above the ground at z = 0 and looks along -z.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import prints
from solids import Body, ball, box, grid, joined, placed, tube, turned, turning
from surfaces import glossy, matte, mesh, panel, texture, tones

SIGN_Y = 2.56
SUN, SKY, LAMP, DIAL = 72.0, 5.2, 150.0, 3.0  # W m^-2; W m^-2 sr^-1
SUN_UP_DEG = 34.0
CLOCK, CLOCK_R = np.array([-0.92, 2.86, -44.0]), 0.28
CAR_Z, WALL_Z, FENCE_Z = -52.0, -72.0, -20.5
DECK_Y = 0.85  # of the deck on which the van stands


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng(int(params["seed"]))
    paper, ink = 0.74, 0.74 - float(params["contrast"]) * 0.69
    inks = (paper, ink) if params["negative"] == "light" else (ink, paper)
    place = np.array([float(params["aside_m"]), SIGN_Y, -float(params["distance_m"])])
    turn = turning([0, 1, 0], float(params["turn_deg"]))
    wide, high = (side / 2 for side in prints.SIGN_M)
    front = grid([[(-wide, -high, 0), (wide, -high, 0)], [(-wide, high, 0), (wide, high, 0)]])
    back = box((-wide - 0.02, -high - 0.02, -0.05), (wide + 0.02, high + 0.02, -0.002), tone=0.12)
    posts = [
        tube([(x, -SIGN_Y, -0.09), (x, high + 0.1, -0.09)], 0.038, around=24, tone=0.30)
        for x in (-0.36, 0.36)
    ]
    enamel = glossy(texture(prints.sign(params["layout"], inks, random)), 0.25)
    scene = {
        "sign": mesh("sign", placed(front, place, turn=turn), enamel, smooth=False),
        "sign_post": mesh(
            "sign_post", placed(joined([back, *posts]), place, turn=turn), matte(tones()), smooth=False
        ),
    }
    scene |= _clock(float(params["time_min"])) | _car(random) | _fence(random) | _yard(random)
    return scene | _lights(params)


def _clock(time_min: float) -> dict[str, Any]:
    """A clock on a bracketed post, lit round its rim."""
    face = grid([[(-1, -1, 0), (1, -1, 0)], [(-1, 1, 0), (1, 1, 0)]])
    rim = placed(
        turned([(1.0, -0.2), (1.1, -0.2), (1.1, 0.1), (1.02, 0.1)], tone=0.06), turn=turning([1, 0, 0], 90)
    )
    pole = tube([(0, -CLOCK[1], -0.12), (0, -0.3, -0.12)], 0.06, around=24, tone=0.08)
    made = joined([placed(rim, CLOCK, scale=CLOCK_R), placed(pole, CLOCK)])
    dial = placed(face, CLOCK, scale=CLOCK_R)
    return {
        "clock": mesh("clock", dial, matte(texture(prints.clock(time_min))), smooth=False),
        "clock_case": mesh("clock_case", made, matte(tones())),
    }


def _car(random: np.random.Generator) -> dict[str, Any]:
    """The rear of a parked van with its plate; the plate is read where the sign is not."""
    x, tone = 1.04, float(random.choice([0.05, 0.25, 0.6]))
    corners = [
        (-0.85, 0.35),
        (-0.88, 1.0),
        (-0.80, 1.95),
        (-0.66, 2.1),
        (0.66, 2.1),
        (0.80, 1.95),
        (0.88, 1.0),
        (0.85, 0.35),
    ]
    points = np.array([[(x + a, b, CAR_Z - d) for a, b in corners] for d in (4.0, 0.0)])
    shell = grid(points[::-1], tone=tone)
    rear = grid(
        np.array([[(x + a * k, 0.35 + (b - 0.35) * k, CAR_Z) for a, b in corners] for k in (0.02, 1.0)]),
        tone=tone,
    )
    parts = [shell, rear, box((x - 0.6, 1.3, CAR_Z), (x + 0.6, 1.9, CAR_Z + 0.012), tone=0.03)]
    for side in (-1, 1):
        middle = x + 0.72 * side
        parts.append(box((middle - 0.07, 0.7, CAR_Z), (middle + 0.07, 1.1, CAR_Z + 0.03), tone=0.22))
        parts.append(ball((x + 0.66 * side, 0.3, CAR_Z - 0.4), (0.11, 0.3, 0.3), tone=0.03))
    parts.append(box((x - 0.88, 0.38, CAR_Z), (x + 0.88, 0.58, CAR_Z + 0.08), tone=0.05))
    sheet = grid([[(x - 0.26, 0.7, 0), (x + 0.26, 0.7, 0)], [(x - 0.26, 0.81, 0), (x + 0.26, 0.81, 0)]])
    plate = placed(sheet, (0, DECK_Y + 0.35, CAR_Z + 0.03))
    deck = box((x - 2.5, 0, CAR_Z - 6), (x + 2.5, DECK_Y, CAR_Z + 1.0), tone=0.30)
    return {
        "deck": mesh("deck", deck, matte(tones()), smooth=False),
        "van": mesh("van", placed(joined(parts), (0, DECK_Y, 0)), matte(tones()), smooth=False),
        "plate": mesh("plate", plate, matte(texture(prints.plate(random))), smooth=False),
    }


def _fence(random: np.random.Generator) -> dict[str, Any]:
    """A railing nearer than the sign, its spear heads in the lower edge of the picture."""
    bars: list[Body] = []
    for k in range(22):
        x = -1.1 + 0.105 * k
        bars.append(tube([(x, 0, FENCE_Z), (x, 2.2, FENCE_Z)], 0.011, around=10, tone=0.06))
        spear = turned(
            [(0.011, 0.0), (0.024, 0.035), (0.0, 0.12)], around=12, tone=0.5 if k % 4 == 0 else 0.08
        )
        bars.append(placed(spear, (x, 2.2, FENCE_Z)))
    bars.append(box((-1.3, 2.1, FENCE_Z - 0.01), (1.3, 2.135, FENCE_Z + 0.01), tone=0.06))
    return {"fence": mesh("fence", joined(bars), matte(tones()))}


def _yard(random: np.random.Generator) -> dict[str, Any]:
    """Asphalt, a brick wall with bills and a lintel, far away."""
    ground = grid([[(-12, 0, -12), (12, 0, -12)], [(-12, 0, WALL_Z), (12, 0, WALL_Z)]])
    wall = grid([[(-6, 0, WALL_Z), (6, 0, WALL_Z)], [(-6, 7.2, WALL_Z), (6, 7.2, WALL_Z)]])
    scene = {
        "ground": mesh(
            "ground", ground, matte(texture(prints.asphalt(random), repeat=(6, 15))), smooth=False
        ),
        "wall": mesh("wall", wall, matte(texture(prints.brick(random), repeat=(5, 3))), smooth=False),
    }
    for k, (x, y) in enumerate(((-1.75, 2.6), (-0.2, 2.5), (1.35, 2.7), (0.55, 4.6))):
        pose = mi.ScalarTransform4f().translate([x, y, WALL_Z + 0.02]).scale([0.6, 0.85, 1])
        bill = matte(texture(prints.poster(random)))
        scene[f"bill_{k}"] = {"type": "rectangle", "to_world": pose, "bsdf": bill}
    return scene


def _lights(params: dict[str, Any]) -> dict[str, Any]:
    """A low sun from the side, the sky, and the yard's lamps before the sign and over the clock."""
    azimuth, up = np.radians([float(params["sun_azimuth_deg"]), SUN_UP_DEG])
    sun = np.array([np.sin(azimuth) * np.cos(up), np.sin(up), np.cos(azimuth) * np.cos(up)])
    sign = np.array([0, SIGN_Y, -float(params["distance_m"])])
    made = {
        "sun": {"type": "directional", "direction": (-sun).tolist(), "irradiance": SUN},
        "sky": {"type": "constant", "radiance": SKY},
        "clock_light": panel(CLOCK + np.array([0, 0.75, 0.5]), CLOCK, (0.5, 0.12), 10 * DIAL),
    }
    for k, x in enumerate((-1.1, 1.1)):  # from below, so that they cast no shadow of the sun
        made[f"lamp_{k}"] = panel(sign + np.array([x, -1.7, 2.4]), sign, (0.5, 0.3), LAMP)
    return made
