"""The target: an inn's painted sign on an iron bracket, with two small lamps over its face.

About its own middle: x right, y up, z towards the camera.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import mitsuba as mi
import numpy as np
from meshes import Body, box, joined, quad, texture, tube

WIDE_M, HIGH_M, THICK_M = 0.32, 0.27, 0.024
TEXEL_M = 0.0006  # a pixel sees 2 mm
LAMP_M, LAMP_AT = 0.022, ((-0.085, 0.225, 0.20), (0.085, 0.225, 0.20))


def picture(random: np.random.Generator, contrast: float) -> np.ndarray:
    """The painting: a bird, a ship or a star over waves, the inn's name below; cracked and rained on."""
    rows, columns = int(HIGH_M / TEXEL_M), int(WIDE_M / TEXEL_M)
    y = (0.5 - (np.arange(rows) + 0.5) / rows)[:, None] * HIGH_M
    x = ((np.arange(columns) + 0.5) / columns - 0.5)[None, :] * WIDE_M
    dark, light = (0.10, 0.62) if random.random() < 0.5 else (0.62, 0.08)
    art = np.full((rows, columns), dark, dtype=np.float64)
    centre = y - 0.030
    rays = (np.sin(19 * np.arctan2(centre, x + 0 * y) + random.uniform(0, 6)) > 0) & (np.hypot(x, centre) > 0.06)
    art[rays & (centre > -0.085)] *= 1.35 if dark < 0.5 else 0.8
    emblem, text = ((_bird, "THE WREN"), (_ship, "THE SHIP"), (_star, "THE STAR"))[int(random.integers(3))]
    art[emblem(x, centre)] = light
    for low in (0.071, 0.080, 0.089):
        art[np.abs(centre + low - 0.004 * np.sin(2 * np.pi * x / 0.029 + 90 * low)) < 0.0022] = light
    _name(art, x, y, text, light)
    rim = np.maximum(np.abs(x) / WIDE_M, np.abs(y) / HIGH_M + 0 * x)
    rope = np.sin(2 * np.pi * (np.where(np.abs(y) / HIGH_M > np.abs(x) / WIDE_M, x, y) - 0.6 * rim) / 0.0075) > 0
    art[(rim > 0.440) & (rim < 0.472) & rope] = light
    art[rim > 0.482] = 0.05
    grain = random.standard_normal((rows, columns))
    streaks = np.repeat(np.cumsum(random.standard_normal((6, columns)), axis=1) / 12, -(-rows // 6), axis=0)[:rows]
    art *= 1 + contrast * (0.10 * grain + 0.12 * np.tanh(streaks))
    for _ in range(int(60 * contrast)):  # cracks in the paint, mostly along the boards
        steps = int(random.integers(15, 120))
        heading = np.cumsum(random.normal(0, 0.25, steps)) * 0.3
        r = (random.uniform(0, rows) + np.cumsum(np.sin(heading))).astype(int)
        c = (random.uniform(0, columns) + np.cumsum(np.cos(heading))).astype(int)
        inside = (r >= 0) & (r < rows) & (c >= 0) & (c < columns)
        art[r[inside], c[inside]] = 0.25
    return np.clip(art, 0.03, 0.85).astype(np.float32)


def _bird(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    body = (x / 0.062) ** 2 + ((y + 0.004) / 0.030) ** 2 < 1
    head = np.hypot(x - 0.058, y - 0.030) < 0.019
    beak = (x > 0.07) & (x < 0.097) & (np.abs(y - 0.030) < 0.35 * (0.097 - x))
    tail = (x < -0.045) & (x > -0.105) & (np.abs(y - 0.016 + 0.5 * (x + 0.045)) < 0.15 * (-0.035 - x) + 0.006)
    wing = (np.hypot(x + 0.012, y - 0.012) < 0.028) & (np.mod(x - y, 0.012) < 0.004)
    legs = ((np.abs(x - 0.004) < 0.002) | (np.abs(x + 0.016) < 0.002)) & (y < -0.02) & (y > -0.068)
    eye = np.hypot(x - 0.062, y - 0.034) < 0.004
    return (body | head | beak | tail | legs) & ~wing & ~eye


def _ship(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    hull = (y < -0.030) & (y > -0.066) & (np.abs(x) < 0.088 + 0.6 * (y + 0.03)) & (np.abs(y + 0.046) > 0.003)
    masts = ((np.abs(x + 0.028) < 0.0022) | (np.abs(x - 0.030) < 0.0022)) & (y > -0.03) & (y < 0.088)
    sails = np.zeros(np.broadcast_shapes(x.shape, y.shape), dtype=bool)
    for mast in (-0.028, 0.030):
        for low, high, half in ((-0.020, 0.018, 0.030), (0.024, 0.052, 0.023), (0.058, 0.078, 0.015)):
            bulge = 0.006 * np.sin(np.pi * (y - low) / (high - low))
            sails |= (y > low) & (y < high) & (np.abs(x - mast - bulge) < half - 0.1 * (y - low))
    return hull | masts | sails


def _star(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    angle, far = np.arctan2(x + 0 * y, y + 0 * x), np.hypot(x, y)
    fold = np.abs(np.mod(angle, 2 * np.pi / 8) - np.pi / 8) / (np.pi / 8)
    points = far < 0.036 + 0.046 * (1 - fold) ** 1.0 * 0 + 0.046 * fold
    return (points & (far > 0.022)) | (far < 0.014)


# Capitals as strokes in a box 1 wide and 1 high, (x, y) from the lower left.
GLYPHS = {
    " ": [],
    "A": [[(0, 0), (0.5, 1), (1, 0)], [(0.22, 0.38), (0.78, 0.38)]],
    "E": [[(0.9, 0), (0.1, 0), (0.1, 1), (0.9, 1)], [(0.1, 0.52), (0.7, 0.52)]],
    "H": [[(0.08, 0), (0.08, 1)], [(0.92, 0), (0.92, 1)], [(0.08, 0.5), (0.92, 0.5)]],
    "I": [[(0.5, 0), (0.5, 1)], [(0.25, 0), (0.75, 0)], [(0.25, 1), (0.75, 1)]],
    "N": [[(0.08, 0), (0.08, 1), (0.92, 0), (0.92, 1)]],
    "P": [[(0.1, 0), (0.1, 1), (0.65, 1), (0.92, 0.75), (0.65, 0.48), (0.1, 0.48)]],
    "R": [[(0.1, 0), (0.1, 1), (0.65, 1), (0.92, 0.75), (0.65, 0.48), (0.1, 0.48)], [(0.5, 0.48), (0.95, 0)]],
    "S": [[(0.9, 0.85), (0.6, 1), (0.15, 0.9), (0.12, 0.65), (0.85, 0.4), (0.9, 0.15), (0.5, 0),
           (0.1, 0.15)]],
    "T": [[(0.5, 0), (0.5, 1)], [(0.02, 1), (0.98, 1)]],
    "W": [[(0, 1), (0.25, 0), (0.5, 0.8), (0.75, 0), (1, 1)]],
}  # fmt: skip


def _name(art: np.ndarray, x: np.ndarray, y: np.ndarray, text: str, ink: float) -> None:
    """A line of capitals below the emblem, in place."""
    high, wide, step, thick = 0.034, 0.025, 0.033, 0.0032
    left, foot = -0.5 * (step * len(text) - (step - wide)), -0.115
    for number, letter in enumerate(text):
        for stroke in GLYPHS[letter]:
            points = np.array(stroke) * [wide, high] + [left + number * step, foot]
            for (x0, y0), (x1, y1) in pairwise(points):
                dx, dy = x1 - x0, y1 - y0
                along = np.clip(((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy), 0, 1)
                art[np.hypot(x - x0 - along * dx, y - y0 - along * dy) < thick] = ink


def board() -> Body:
    """Both painted faces; the picture's coordinates are 0..1."""
    w, h, t = WIDE_M / 2, HIGH_M / 2, THICK_M / 2
    uv = [(0, 0), (1, 0), (1, 1), (0, 1)]
    front = quad((-w, -h, t), (w, -h, t), (w, h, t), (-w, h, t), uv=uv)
    return joined([front, quad((w, -h, -t), (-w, -h, -t), (-w, h, -t), (w, h, -t), uv=uv)])


def frame() -> Body:
    """A moulding round the board."""
    w, h, t, lip = WIDE_M / 2, HIGH_M / 2, THICK_M / 2 + 0.008, 0.014
    bars = [((-w - lip, h), (w + lip, h + lip)), ((-w - lip, -h - lip), (w + lip, -h))]
    bars += [((-w - lip, -h), (-w, h)), ((w, -h), (w + lip, h))]
    return joined([box((a, b, -t), (c, d, t), 0.30) for (a, b), (c, d) in bars])


def ironwork(reach: float) -> Body:
    """Bracket with a scroll, chains, and the arms of the lamps; ``reach``: how far right the wall is."""
    top = HIGH_M / 2 + 0.085
    bar = [(-0.22, top, 0), (0.1, top, 0), (reach, top, 0)]
    turn = np.linspace(0, 3.6 * np.pi, 60)
    spiral = 0.085 * np.exp(-turn / 7.5)
    scroll = np.stack([0.30 + spiral * np.cos(turn), top + 0.10 + spiral * np.sin(turn), 0 * turn], axis=1)
    strut = [(0.10, top + 0.01, 0), (0.30, top + 0.16, 0), (0.6, top + 0.33, 0), (reach, top + 0.42, 0)]
    parts = [
        tube(bar, 0.009),
        tube(strut, 0.007),
        tube(scroll, 0.006),
        tube([(-0.22, top, 0), (-0.245, top + 0.03, 0), (-0.22, top + 0.05, 0)], 0.007),
    ]
    for x in (-0.14, 0.14):
        for k in range(4):
            y = top - 0.012 - 0.021 * k
            loop = np.linspace(0, 2 * np.pi, 13)
            flat = np.stack([x + 0.007 * np.cos(loop), y + 0.013 * np.sin(loop), 0 * loop], axis=1)
            parts.append(tube(flat if k % 2 else flat[:, [2, 1, 0]] + np.array([x, 0, -x]), 0.0022, around=6))
    for x, y, z in LAMP_AT:
        parts.append(tube([(x, top, 0), (x, top + 0.03, 0.6 * z), (x, y + 0.02, z)], 0.004, around=8))
        parts.append(tube([(x, y + 0.035, z + 0.012), (x, y + 0.004, z + 0.002)], [0.014, 0.028]))
    return joined(parts)


def lamps(middle: np.ndarray, turn_deg: float, radiance: float) -> dict[str, Any]:
    """Two small discs that look down at the painted face; the camera sees their dark backs."""
    turn = mi.ScalarTransform4f().translate(middle.tolist()).rotate([0, 1, 0], turn_deg)
    made = {}
    for number, (x, y, z) in enumerate(LAMP_AT):
        pose = turn @ mi.ScalarTransform4f().look_at(origin=[x, y, z], target=[0.5 * x, -0.05, 0.0], up=[1, 0, 0])
        made[f"sign_lamp_{number}"] = {
            "type": "disk",
            "to_world": pose @ mi.ScalarTransform4f().scale(LAMP_M),
            "bsdf": {"type": "diffuse", "reflectance": 0.0},
            # Most of the group's samples go where the target needs them.
            "emitter": {"type": "area", "radiance": radiance, "sampling_weight": 20.0},
        }
    return made


def paint(art: np.ndarray) -> dict[str, Any]:
    """Oil paint under old varnish."""
    coat = {"type": "roughplastic", "diffuse_reflectance": texture(art), "alpha": 0.35, "int_ior": 1.45}
    return {"type": "twosided", "bsdf": coat}
