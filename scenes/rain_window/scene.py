"""Rain on a window: drops hang on the outside of the pane, some run down; a street with lit shops behind.

World frame: metres, x right, y up, z towards the lens, which stands at the origin and looks along -z.
"""

from __future__ import annotations

from typing import Any

import drops
import numpy as np
import street
from solids import box, joined, placed, turning
from surfaces import glossy, mesh, panel, texture

WATER = {"type": "dielectric", "int_ior": 1.333, "ext_ior": 1.0}
BAR_M, BAR_AT_M = (0.016, 0.03), 0.043  # width and depth of the glazing bar; how far aside
BAY_RADIANCE, ROOM_RADIANCE, LAMP_RADIANCE = 1.2, 0.03, 0.8  # W m^-2 sr^-1


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1923, int(params["seed"])])
    turn, shift = _pose(params)
    still, runners = drops.on_pane(params, random)
    scene: dict[str, Any] = {"type": "scene", "drops": mesh("drops", placed(still, shift, turn=turn), WATER)}
    for k, runner in enumerate(runners):
        scene[f"runner_{k}"] = mesh(f"runner_{k}", placed(runner, shift, turn=turn), WATER)
    return scene | _bar(params, random) | street.street(params["sky_w"], random) | _room(params)


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """Each runner creeps, slips and creeps again; shifts are from where it is half way through the second."""
    random = np.random.default_rng([1924, int(params["seed"])])
    turn, _ = _pose(params)
    times = np.linspace(0, 1, 21)
    moved = {}
    for k in range(drops.RUNNERS):
        speed = params["run_mm_per_s"] * random.uniform(0.6, 1.4)
        phase = random.uniform(0, 2 * np.pi)
        way = 1e-3 * speed * (times - 0.5 + 0.09 * (np.sin(2 * np.pi * times + phase) + np.sin(phase)))
        moved[f"runner_{k}"] = {
            "keyframes": [
                {"time_s": float(t), "translate_m": (-w * turn[:, 1]).tolist()} for t, w in zip(times, way, strict=True)
            ]
        }
    return moved


def _pose(params: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and shift (m) from the pane to the world."""
    return turning([0, 1, 0], params["yaw_deg"]), np.array([0.0, 0.0, -params["distance_m"]])


def _bar(params: dict[str, Any], random: np.random.Generator) -> dict[str, Any]:
    """A painted glazing bar on the room's side of the pane."""
    side = -1 if params["bar_side"] == "left" else 1
    wide, deep = BAR_M
    rows = street.paint((1200, 60), random)
    bar = box([side * BAR_AT_M - wide / 2, -0.09, 0.0006], [side * BAR_AT_M + wide / 2, 0.09, deep])
    turn, shift = _pose(params)
    paint = glossy(texture(rows), 0.3)
    return {"bar": mesh("bar", placed(joined([bar]), shift, turn=turn), paint, smooth=False)}


def _room(params: dict[str, Any]) -> dict[str, Any]:
    """Another window of the bay, a shaded lamp, and what the walls throw back."""
    pane = np.array([0.0, 0.0, -params["distance_m"]])
    side = 1 if params["bar_side"] == "left" else -1
    return {
        "bay": panel(pane + np.array([side * 0.9, 0.25, 0.7]), pane, (0.8, 1.1), BAY_RADIANCE),
        "lamp": panel(pane + np.array([-side * 0.45, 0.25, 0.8]), pane, (0.9, 0.7), LAMP_RADIANCE),
        "room": {"type": "constant", "radiance": ROOM_RADIANCE},
    }
