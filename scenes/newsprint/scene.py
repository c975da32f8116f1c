"""A clipping from a newspaper, creased, over another page: screened pictures and small type, seen close.

World frame: millimetres, x right, y up the page, z towards the lens; the clipping lies near z = 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from page import page
from solids import Body, grid, placed, turning
from surfaces import matte, mesh, panel, texture

CLIP_MM, PAGE_MM = (44.0, 46.0), (96.0, 66.0)
EDGE_MM = 9.0  # from the middle of the picture to the cut edge of the clipping
CELLS = (92, 88)
LAMP, WINDOW, ROOM = 22.0, 4.0, 0.15  # W m^-2 sr^-1


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (millimetres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1454, int(params["seed"])])
    print_ = matte(texture(page(CLIP_MM, params, random)))
    below = matte(texture(page(PAGE_MM, params | {"picture_columns": 2}, random)))
    side = 1 if params["cut"] == "right" else -1
    clip = _sheet(CLIP_MM, CELLS, params["crease_mm"], random)
    lean = turning([0, 1, 0], params["tilt_deg"]) @ turning([0, 0, 1], params["turn_deg"])
    clip = placed(clip, [side * (EDGE_MM - CLIP_MM[0] / 2), 0, params["height_mm"]], turn=lean)
    flat = _sheet(PAGE_MM, (40, 60), 1.2, random)
    flat = placed(flat, [4 * side, 0, -params["below_mm"]], turn=turning([0, 0, 1], random.uniform(-9, 9)))
    return {
        "clipping": mesh("clipping", clip, print_),
        "page": mesh("page", flat, below),
        **_lights(params),
    }


def _sheet(
    size: tuple[float, float], cells: tuple[int, int], crease_mm: float, random: np.random.Generator
) -> Body:
    """A sheet that bulges, with a few sharp creases across; its middle is at z = 0 on average."""
    y, x = (np.linspace(-0.5, 0.5, n + 1) * long for n, long in zip(cells, size[::-1], strict=True))
    x, y = np.meshgrid(x, y)
    turn, phase = random.uniform(0, 2 * np.pi, 2)
    z = 0.5 * crease_mm * np.sin(2 * np.pi / 55 * (np.cos(turn) * x + np.sin(turn) * y) + phase)
    for way in np.cumsum([random.uniform(0, np.pi), *random.uniform(0.6, 1.4, 3)]):
        off = np.cos(way) * x + np.sin(way) * y - random.uniform(-12, 12)
        sharp = np.sqrt(off * off + 0.25)  # the ridge is rounded over half a millimetre
        z += random.choice([-1, 1]) * crease_mm * 0.055 * np.minimum(sharp, 12 + 0 * sharp)
    z -= np.median(z)
    return grid(np.stack([x, y, z], axis=2))


def _lights(params: dict[str, Any]) -> dict[str, Any]:
    a = np.radians(float(params["lamp_azimuth_deg"]))
    lamp = (380 * np.sin(a), 180 + 60 * np.cos(a), 260)
    return {
        "lamp": panel(lamp, (0, 0, 0), (110, 110), LAMP),
        "window": panel((-500 * np.sign(a), 150, 420), (0, 0, 0), (420, 500), WINDOW),
        "room": {"type": "constant", "radiance": ROOM},
    }
