"""A station yard through a long lens: a weathered sign on posts, leaves, a clock, a brick front.

World frame: metres, x right, y up; the lens stands 2.6 m above the ground at z = 0 and looks along -z.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import prints
import scenery
from solids import Body, ball, box, grid, joined, placed, tube, turned, turning
from surfaces import cloudy, glossy, mesh, panel, texture

SIGN_Y = 2.56
SUN, SKY, LAMP, DIAL = 72.0, 5.2, 150.0, 3.0  # W m^-2; W m^-2 sr^-1
SUN_UP_DEG = 34.0
POST_X, POST_R = 0.34, 0.038
CORNER, RIM, SAG = 0.018, 0.006, 0.004  # radius of a plate's corners, its rolled edge, its camber


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1838, int(params["seed"])])
    paper, ink = 0.72, 0.72 - float(params["contrast"]) * 0.67
    inks = (paper, ink) if params["negative"] == "light" else (ink, paper)
    place = np.array([float(params["aside_m"]), SIGN_Y, -float(params["distance_m"])])
    turn = turning([0, 1, 0], float(params["turn_deg"]))
    scene: dict[str, Any] = {}
    fittings: list[Body] = []
    plates: list[Body] = []
    panels = prints.sign(str(params["layout"]), inks, random)
    for k, part in enumerate(panels):
        lean = turning([0, 0, 1], random.normal(0, 0.35)) @ turning([1, 0, 0], random.normal(0, 0.6))
        middle = np.array([*part.middle, 0.0])
        plate = placed(_plate(part.size), middle, turn=lean)
        strip = np.array([[0.0, len(panels) - 1 - k]])  # of the pictures above each other
        plates.append(plate._replace(uv=(plate.uv + strip) / np.array([1, len(panels)])))
        fittings += [placed(body, middle, turn=lean) for body in _fittings(part)]
    high = prints.SIGN_M[1] / 2
    for x in (-POST_X, POST_X):
        fittings.append(tube([(x, -SIGN_Y, -0.075), (x, high + 0.055, -0.075)], POST_R, around=32, tone=0.27))
        cap = turned([(0.041, 0), (0.043, 0.004), (0.043, 0.022), (0.030, 0.030), (0.0, 0.034)], around=32, tone=0.07)
        fittings.append(placed(cap, (x, high + 0.05, -0.075)))
    front = placed(joined(plates), place, turn=turn)
    picture = np.concatenate([part.picture for part in panels])
    scene["sign"] = mesh("sign", front, glossy(texture(picture), 0.09))
    post = placed(joined(fittings), place, turn=turn)
    scene["sign_post"] = mesh("sign_post", _spangled(post, random), scenery.coated(0.45))
    side = 1 if random.random() < 0.5 else -1
    scene |= scenery.clock(float(params["time_min"])) | scenery.tree(1, random)
    scene |= scenery.twig(side, random) | scenery.front(random)
    return scene | _lights(params)


def _plate(size: tuple[float, float]) -> Body:
    """The face of a plate with round corners, slightly cambered, its edge rolled back."""
    wide, high = size[0] / 2, size[1] / 2
    inset = np.concatenate([np.linspace(0, RIM, 5), np.linspace(RIM, min(wide, high), 9)[1:]])
    a = np.linspace(0, np.pi / 2, 13)
    rings = []
    for step in inset:
        r = max(CORNER - step, 0.0)
        w, h = wide - step, high - step
        quarters = ((1, 1, 0), (-1, 1, 1), (-1, -1, 2), (1, -1, 3))
        corner = [(sx * (w - r) + r * np.cos(t), sy * (h - r) + r * np.sin(t)) for sx, sy, first in
                  quarters for t in a + first * np.pi / 2]  # fmt: skip
        rings.append(np.array([*corner, corner[0]]))
    flat = np.array(rings)
    roll = RIM - np.sqrt(np.clip(RIM**2 - np.clip(RIM - inset, 0, None) ** 2, 0, None))
    z = SAG * (1 - (flat[..., 0] / wide) ** 2) * (1 - (flat[..., 1] / high) ** 2) - 0.6 * roll[:, None]
    uv = flat / np.array(size) + 0.5
    return grid(np.concatenate([flat, z[..., None]], axis=2), uv=uv)


def _fittings(part: prints.Panel) -> list[Body]:
    """The back of a plate, bolts with washers, and the rails and clamps that hold it to the posts."""
    wide, high = part.size[0] / 2, part.size[1] / 2
    parts = [box((-wide + 0.004, -high + 0.004, -0.012), (wide - 0.004, high - 0.004, -0.006), tone=0.12)]
    for x, y in part.bolts:
        washer = turned([(0.0095, 0), (0.0095, 0.002), (0.006, 0.0022)], around=20, tone=0.30)
        head = turned([(0.0062, 0.002), (0.0062, 0.005), (0.004, 0.0072), (0.0, 0.0078)], around=20, tone=0.22)
        up = turning([1, 0, 0], 90)
        level = SAG * (1 - (x / wide) ** 2) * (1 - (y / high) ** 2)
        parts += [placed(body, (x, y, level), turn=up) for body in (washer, head)]
    for y in (-0.7 * high, 0.7 * high) if high > 0.2 else (0.0,):
        parts.append(box((-wide + 0.03, y - 0.02, -0.040), (wide - 0.03, y + 0.02, -0.012), tone=0.30))
        for x in (-POST_X, POST_X):
            ring = tube([(x, y - 0.014, -0.075), (x, y + 0.014, -0.075)], POST_R + 0.005, around=28, tone=0.33)
            parts += [ring, ball((x + 0.045, y, -0.045), 0.008, tone=0.25)]
    return parts


def _spangled(body: Body, random: np.random.Generator) -> Body:
    """Zinc in flecks, darker streaks down the posts."""
    lump = cloudy((256, 256), 24, 4, random)
    at = np.mod((body.vertices[:, [0, 1]] * 900).astype(int), 256)
    return body._replace(tone=np.clip(body.tone * (1 + 0.22 * lump[at[:, 1], at[:, 0]]), 0.02, 0.6))


def _lights(params: dict[str, Any]) -> dict[str, Any]:
    """A low sun from the side, the sky, and the yard's lamps before the sign and over the clock."""
    azimuth, up = np.radians([float(params["sun_azimuth_deg"]), SUN_UP_DEG])
    sun = np.array([np.sin(azimuth) * np.cos(up), np.sin(up), np.cos(azimuth) * np.cos(up)])
    sign = np.array([0, SIGN_Y, -float(params["distance_m"])])
    dial = scenery.CLOCK
    made = {
        "sun": {"type": "directional", "direction": (-sun).tolist(), "irradiance": SUN, "sampling_weight": 4.0},
        "sky": {"type": "constant", "radiance": SKY},
        "clock_light": panel(dial + np.array([0, 0.75, 0.5]), dial, (0.5, 0.12), 10 * DIAL),
    }
    for k, x in enumerate((-1.1, 1.1)):  # from below, so that they cast no shadow of the sun
        made[f"lamp_{k}"] = panel(sign + np.array([x, -1.7, 2.4]), sign, (0.5, 0.3), LAMP)
    return made
