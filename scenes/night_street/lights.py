"""What shines, but for cars and the sign: street lamps, shop windows, festoon, lit rooms, sky glow.

Radiances in W m^-2 sr^-1 of the visible band, 300 lm/W as white LEDs have: 1 W m^-2 sr^-1 is 300 cd m^-2.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
from street import END_Z, KERB, LEFT_KERB, LEFT_WALL, RIGHT_KERB, RIGHT_WALL

GLOBE_M, GLOBE_HIGH = 0.16, 4.2
GLOBE = 26.0  # 7,800 cd m^-2: a frosted globe of 7,900 lm
SHOP, ROOM, BULB, SKY = 1.4, 0.25, 4.0, 5e-4
# Globes at both kerbs; some stand outside the picture, two behind the camera.
POSTS = [(RIGHT_KERB + 0.3, z) for z in (-12.0, -30.0, -49.0, -67.0, -86.0)]
POSTS += [(LEFT_KERB - 0.3, z) for z in (-39.0, -95.0, -109.0)]
POSTS += [(RIGHT_KERB + 0.3, 11.0), (LEFT_KERB - 0.3, 3.0)]
BULBS = 7


def globes() -> dict[str, Any]:
    """street_0, street_1, ...: a globe on every post."""
    return {f"street_{k}": _ball((x, KERB + GLOBE_HIGH, z), GLOBE_M, GLOBE) for k, (x, z) in enumerate(POSTS)}


def festoon() -> tuple[dict[str, Any], np.ndarray]:
    """Bulbs hung across the street, and the cable that they hang on, (n, 3)."""
    span = np.linspace(0, 1, 41)
    x = RIGHT_WALL + span * (LEFT_WALL - RIGHT_WALL)
    cable = np.stack([x, 5.2 - 1.85 * 4 * span * (1 - span), np.full_like(x, -24.0)], axis=1)
    at = [cable[round(k)] for k in np.linspace(8, 24, BULBS)]
    bulbs = {f"bulb_{k}": _ball(tuple(p - [0, 0.06, 0]), 0.035, BULB) for k, p in enumerate(at)}
    return bulbs, cable


def windows(random: np.random.Generator) -> dict[str, Any]:
    """Lit shops: on the right wall, seen aslant; on the left wall far away; across the end of the street."""
    made = {}
    places = [(-11.0, -1), (-17.0, -1), (-29.0, -1), (-41.0, -1), (-59.0, -1), (-98.0, 1), (-110.0, 1)]
    for k, (z, face) in enumerate(places):
        x = (RIGHT_WALL if face < 0 else LEFT_WALL) + face * 0.02
        at = mi.ScalarTransform4f().translate([x, 1.62, z]).rotate([0, 1, 0], face * 90)
        made[f"shop_{k}"] = _pane(at, 3.8, 2.1, SHOP * float(random.uniform(0.5, 1.3)), shop_picture(random))
    wide = RIGHT_WALL - LEFT_WALL
    at = mi.ScalarTransform4f().translate([0.5 * (RIGHT_WALL + LEFT_WALL), 4.5, END_Z])
    made["end_house"] = _pane(at, wide, 9.0, 1.0, front_picture(random), wall=0.3)
    return made


def _pane(
    at: Any, wide: float, high: float, radiance: float, picture: np.ndarray, *, wall: float = 0.04
) -> dict[str, Any]:
    rows = np.ascontiguousarray(picture[::-1] * radiance, dtype=np.float32)
    glow = {"type": "bitmap", "bitmap": mi.Bitmap(rows), "raw": True}
    return {
        "type": "rectangle",
        "to_world": at @ mi.ScalarTransform4f().scale([wide / 2, high / 2, 1]),
        "bsdf": {"type": "diffuse", "reflectance": wall},
        "emitter": {"type": "area", "radiance": glow},
    }


def shop_picture(random: np.random.Generator) -> np.ndarray:
    """What is lit behind a shop window, 0..1: shelves with goods, or figures before a bright wall."""
    rows, columns = 84, 152
    y, x = np.mgrid[0:rows, 0:columns]
    lamp = np.exp(-(((x / columns * 4) % 1 - 0.5) ** 2) / 0.05) * np.exp(-y / 30)
    room = 0.45 + 0.55 * lamp
    if random.random() < 0.5:
        for shelf in range(3):
            foot = 24 + 22 * shelf
            room[foot : foot + 2] = 0.12
            left = 2
            while left < columns - 8:
                wide, high = int(random.integers(3, 9)), int(random.integers(6, 19))
                room[foot - high : foot, left : left + wide] *= random.uniform(0.1, 1.0)
                left += wide + int(random.integers(1, 4))
    else:
        for at in random.uniform(10, columns - 10, 5):
            body = (np.abs(x - at) < 5 + 2 * np.sin(y / 9)) & (y > 30)
            head = np.hypot(x - at, y - 23) < 4.5
            room[body | head] *= random.uniform(0.08, 0.5)
    room[:, ::38] = room[:, 1::38] = 0.03
    room[-4:] = room[:3] = 0.03
    return room


def front_picture(random: np.random.Generator) -> np.ndarray:
    """Radiance of the house across the end, 8.4 m × 9 m at 5 cm: shop fronts below, some rooms lit above."""
    wide = round((RIGHT_WALL - LEFT_WALL) / 0.05)
    glow = np.zeros((180, wide))
    for left in (8, 90):
        shop = shop_picture(random)[:50, :70]
        glow[124:174, left : left + 70] = SHOP * shop
        glow[112:120, left + 10 : left + 58] = 1.6 * (random.random((8, 48)) < 0.62)  # letters that shine
    for storey in (62, 14):
        for k in range(5):
            if random.random() < 0.5:
                room = ROOM * random.uniform(0.3, 1.3) * np.ones((32, 20))
                room[:, 9:11] = 0.0
                room[10:12] = 0.0
                room[:, : int(random.integers(0, 9))] *= 0.4
                glow[storey : storey + 32, 10 + 31 * k : 30 + 31 * k] = room
    return glow


def sky() -> dict[str, Any]:
    """The glow of a town on low clouds: 0.15 cd m^-2."""
    return {"type": "constant", "radiance": SKY}


def _ball(centre: tuple[float, ...], radius: float, radiance: float) -> dict[str, Any]:
    return {
        "type": "sphere",
        "center": [float(c) for c in centre],
        "radius": radius,
        "bsdf": {"type": "diffuse", "reflectance": 0.5},
        "emitter": {"type": "area", "radiance": radiance},
    }
