"""Struck coins on leather under raking light: one leans on a stack and faces the lens, others lie about.

World frame: millimetres, x right, y up, z towards the lens, which looks down by 35 degrees; leather at y = 0.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import relief
from solids import Body, grid, joined, placed, turning
from surfaces import cloudy, glossy, mesh, noise, panel, texture

DOWN_DEG = 35.0
THICK = 1.9
TEXEL_MM = 0.035  # of the pictures of metal; a pixel sees 0.12 mm
SIDE_MM = 25.0  # of the picture of a face
RAKE, WINDOW, ROOM = 2.8, 1.3, 0.10  # W m^-2 sr^-1
METALS = {"silver": 0.98, "nickel": 0.63, "bronze": 0.63, "brass": 0.73}  # reflectance at normal incidence
FIELD_ALPHA, RELIEF_ALPHA = 0.13, 0.28  # bright field, frosted relief; wear makes both alike
# Coins that lie about the leaning one: x, z, number in the stack.
STACKS = ((-1.0, -13.0, 4), (-26.0, -20.0, 7), (25.0, -30.0, 3), (2.0, -48.0, 10), (-38.0, -62.0, 5), (36.0, -70.0, 8))
LOOSE = ((-27.5, 7.0), (26.5, 4.0), (-23.0, 35.0), (24.0, 32.0), (0.5, 48.0), (-4.0, -78.0), (50.0, -14.0))


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (millimetres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng(int(params["seed"]))
    wear = float(params["wear"])
    fine = _disc(200, 760)
    die = int(random.integers(1 << 30))
    height = relief.face(fine[..., 0], fine[..., 1], params["motif"], np.random.default_rng(die))
    target = _struck(fine, height * (1 - 0.25 * wear))
    x, y = _picture_grid()
    raised = relief.face(x, y, params["motif"], np.random.default_rng(die)) > 0.06
    skin = _metal(str(params["metal"]), raised, wear, random)
    lean = turning([1, 0, 0], float(params["tilt_deg"]) - DOWN_DEG)
    lean = lean @ turning([0, 0, 1], float(params["turn_deg"]))
    away = np.radians(DOWN_DEG)
    ahead = np.array([0, np.sin(away), np.cos(away)])
    nearer = float(params["nearer_mm"])
    middle = np.array([0, relief.RADIUS * np.cos(away) + 0.15, nearer])
    scene = {"coin": mesh("coin", placed(target, middle + 0.1 * ahead, turn=lean), skin)}
    scene["others"] = mesh("others", _others(random, nearer), _metal("nickel", None, 0.7, random))
    scene["leather"] = mesh("leather", _flat(), _leather(random), smooth=False)
    return scene | _lights(params)


def _disc(rings: int, around: int) -> np.ndarray:
    """Points (rings + 1, around + 1, 2) of the disc, outermost first, so that its front is +z."""
    r = relief.RADIUS * np.linspace(1, 0, rings + 1)[:, None]
    a = np.linspace(0, 2 * np.pi, around + 1)
    return np.stack([r * np.cos(a), r * np.sin(a)], axis=2)


def _struck(points: np.ndarray, height: np.ndarray) -> Body:
    """A coin: the face over z = 0, the reeded edge, the back; the picture is laid on along z."""
    turn = np.linspace(0, 2 * np.pi, points.shape[1])
    reeds = 1 + 0.006 * np.sign(np.sin(110 * turn))
    edge = [np.stack([*(points[0].T * reeds), np.full(len(turn), z)], axis=1) for z in (-THICK, height[0, 0] - 0.12)]
    back = np.stack([0 * turn, 0 * turn, 0 * turn - THICK], axis=1)
    rows = [back, np.stack([*points[0].T, 0 * turn - THICK], axis=1), *edge]
    rows += list(np.concatenate([points, height[..., None]], axis=2))
    stacked = np.array(rows)
    return grid(stacked, uv=stacked[..., :2] / SIDE_MM + 0.5)


def _picture_grid() -> tuple[np.ndarray, np.ndarray]:
    """Places (mm) of the texels of a face's picture, row 0 on top."""
    n = round(SIDE_MM / TEXEL_MM)
    at = (np.arange(n) + 0.5) * TEXEL_MM - SIDE_MM / 2
    x, y = np.meshgrid(at, at[::-1])
    return x, y


def _metal(kind: str, raised: np.ndarray | None, wear: float, random: np.random.Generator) -> Any:
    """Bright field and frosted relief; tarnish, scratches, finger marks. ``raised`` says where relief is."""
    x, y = _picture_grid()
    n = len(x)
    r = np.hypot(x, y)
    cloud = cloudy((n, n), 5, 5, random)
    alpha = np.where(True if raised is None else raised, RELIEF_ALPHA, FIELD_ALPHA + 0.12 * wear) + 0.03 * cloud
    bright = 0.92 - 0.10 * np.clip(cloud, 0, 1) - 0.28 * wear * np.clip(0.5 + cloudy((n, n), 9, 4, random), 0, 1)
    bright *= 1 - 0.30 * wear * np.exp(-(((r - 10.2) / 0.5) ** 2))
    for _ in range(round(40 + 160 * wear)):
        cx, cy = random.uniform(-12, 12, 2)
        a, length = random.uniform(0, np.pi), random.exponential(1.6)
        reach = int(length / TEXEL_MM) + 2
        column, row = round((cx + SIDE_MM / 2) / TEXEL_MM), round((SIDE_MM / 2 - cy) / TEXEL_MM)
        part = np.s_[max(row - reach, 0) : row + reach, max(column - reach, 0) : column + reach]
        u = (x[part] - cx) * np.cos(a) + (y[part] - cy) * np.sin(a)
        v = (y[part] - cy) * np.cos(a) - (x[part] - cx) * np.sin(a)
        line = (np.abs(v) < 0.03) & (np.abs(u) < length)
        alpha[part][line] += 0.12
        bright[part][line] *= 0.8
    bright *= 1 + 0.05 * noise((n, n), (n / 2.5, n / 2.5), random)
    made = {
        "type": "principled",  # whose paths share what they find, unlike those of a conductor
        "metallic": 1.0,
        "base_color": texture(np.clip(METALS[kind] * bright, 0.05, 1.0)),
        "roughness": texture(np.sqrt(np.clip(alpha, 0.06, 0.4))),
    }
    return mi.load_dict({"type": "twosided", "bsdf": made})


def _others(random: np.random.Generator, nearer: float) -> Body:
    """Stacks behind the leaning coin and coins that lie about, each turned as it fell."""
    coarse = _disc(90, 300)
    kinds = [_struck(coarse, relief.face(coarse[..., 0], coarse[..., 1], m, random)) for m in ("tree", "ship", "fish")]
    plain = _struck(_disc(3, 300), np.array([[0.35] * 301, [0.3] * 301, [0.1] * 301, [0.1] * 301]))
    flat, made = turning([1, 0, 0], -90), []
    for n, (x, z, count) in enumerate(STACKS):
        for k in range(count):
            body = kinds[n % 3] if k == count - 1 else plain
            shift = [x + random.normal(0, 0.35), THICK + (THICK + 0.42) * k, z + random.normal(0, 0.35) + nearer]
            made.append(placed(body, shift, turn=flat @ turning([0, 0, 1], random.uniform(0, 360))))
    for n, (x, z) in enumerate(LOOSE):
        shift = [x + random.normal(0, 0.8), THICK + 0.05, z + random.normal(0, 0.8) + nearer]
        made.append(placed(kinds[(n + 1) % 3], shift, turn=flat @ turning([0, 0, 1], random.uniform(0, 360))))
    return joined(made)


def _flat() -> Body:
    return grid([[(-160, 0, 90), (160, 0, 90)], [(-160, 0, -230), (160, 0, -230)]])


def _leather(random: np.random.Generator) -> Any:
    """Dark leather with a pebbled grain of 0.7 mm, 32 mm a repeat."""
    n = 800
    grain = noise((n, n), (46, 46), random) + 0.6 * noise((n, n), (92, 92), random)
    creases = np.clip(1 - 3.0 * np.abs(grain), 0, 1)
    grey = 0.045 * (1 - 0.75 * creases) * (1 + 0.12 * noise((n, n), (n / 2, n / 2), random))
    return mi.load_dict(glossy(texture(np.clip(grey, 0.012, 0.3), repeat=(10, 10)), 0.35))


def _lights(params: dict[str, Any]) -> dict[str, Any]:
    """A long lamp near the plane of the leaning coin, to one side; a window; the room."""
    a, down = np.radians(float(params["rake_azimuth_deg"])), np.radians(DOWN_DEG)
    ahead, up = np.array([0, np.sin(down), np.cos(down)]), np.array([0, np.cos(down), -np.sin(down)])
    towards = np.array([0, 10.0, 0])
    origin = towards + 260 * (np.sin(a) * np.array([1.0, 0, 0]) + np.cos(a) * up + 0.42 * ahead)
    origin[1] = max(origin[1], 60.0)
    return {
        "rake": panel(origin, towards, (280, 200), RAKE),
        "window": panel((-380 * np.sign(a), 420, -160), towards, (420, 420), WINDOW),
        "room": {"type": "constant", "radiance": ROOM},
    }
