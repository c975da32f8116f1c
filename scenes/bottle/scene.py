"""A small square bottle of oil on a window sill, a garden behind it; bubbles rise in it.

World frame: metres, x right, y up, z towards the lens, which stands at the origin and looks along -z.
"""

from __future__ import annotations

from typing import Any

import bubbles as air
import glass
import mitsuba as mi
import numpy as np
import prints

SILL_Y, SILL_NEAR, SILL_FAR = -0.0440, 0.17, 0.26  # how far the sill goes before and behind the bottle
LABEL_FOOT, LABEL_OFF = 0.009, 0.0003  # height of its lower edge above the sill; paper before glass
# The garden is a picture 2.6 m from the lens. Smoothed, it is as unsharp as one that is far away: f/1.2 would
# blur that by another 44 mrad - 27 mrad at best focus, in squares.
GARDEN_BEHIND, GARDEN_SIZE, GARDEN_SMOOTHED_M = 1.60, (1.05, 0.72), 0.020
FRAME_BEHIND, BAR = 0.28, 0.022  # the window's bars

GARDEN_RADIANCE, ROOM_RADIANCE = 1.5, 0.08  # W m^-2 sr^-1
LAMP_SIZE, LAMP_AWAY, LAMP_UP, LAMP_IRRADIANCE = 0.75, 0.90, 0.50, 1.8  # m; W m^-2 on the label
SELDOM = 0.1  # rays towards what lights the label not at all or evenly; chance finds it often enough
ASIDE_SIZE, ASIDE_RADIANCE = (0.8, 1.0), 4.0  # of the other window


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator.

    ``target`` says what is called `target`: the label, or the glass that the bubbles rise behind.
    """
    pose = _pose(params)
    label, pane = ("target", "pane") if params["target"] == "label" else ("label", "target")
    return {
        "type": "scene",
        label: _label(params, pose),
        **glass.bottle(params["level_m"], pose, pane),
        **_bubbles(params, pose),
        **_window(params),
        **_lights(params),
    }


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """Every bubble that moves within the second; shifts are from where it is at 0.5 s."""
    turn = np.array(_pose(params).matrix, dtype=float)[:3, :3]
    moving = {}
    for name, bubble in _all_bubbles(params):
        shifts = (bubble.places - bubble.at(0.5)) @ turn.T
        if np.ptp(shifts, axis=0).max() > 0:
            keys = zip(bubble.times.tolist(), shifts.tolist(), strict=True)
            moving[name] = {"keyframes": [{"time_s": t, "translate_m": shift} for t, shift in keys]}
    return moving


def _pose(params: dict[str, Any]) -> Any:
    """From the bottle's frame, its foot on the origin, to the world, its face ``distance_m`` away."""
    away = params["distance_m"] + glass.HALF
    turn = mi.ScalarTransform4f().rotate([0, 1, 0], params["yaw_deg"])
    return mi.ScalarTransform4f().translate([params["aside_m"], SILL_Y, -away]) @ turn


def _all_bubbles(params: dict[str, Any]) -> list[tuple[str, air.Bubble]]:
    random = np.random.default_rng([83, params["bubble_seed"]])
    past = "stood_up" if params["target"] == "bubbles" else "shaken"
    made = air.bubbles(params["level_m"], past, random)
    return [(f"bubble_{n:03d}", bubble) for n, bubble in enumerate(made)]


def _bubbles(params: dict[str, Any], pose: Any) -> dict[str, Any]:
    surface = glass.dielectric(glass.AIR, glass.OIL)
    return {
        name: {
            "type": "sphere",
            "to_world": pose @ mi.ScalarTransform4f().translate(b.at(0.5).tolist()).scale(b.radius),
            "bsdf": surface,
        }
        for name, b in _all_bubbles(params)
    }


def _label(params: dict[str, Any], pose: Any) -> dict[str, Any]:
    random = np.random.default_rng([84, params["label_seed"]])
    wide, high = (side * 1e-3 for side in prints.LABEL_MM)
    face = pose @ mi.ScalarTransform4f().translate([0, LABEL_FOOT + high / 2, glass.HALF + LABEL_OFF])
    paper = {"type": "roughplastic", "diffuse_reflectance": _picture(prints.label(random)), "alpha": 0.35}
    return _sheet(face, wide, high, {"type": "twosided", "bsdf": paper})


def _window(params: dict[str, Any]) -> dict[str, Any]:
    """Sill and bars of the window."""
    random = np.random.default_rng(85)
    t = mi.ScalarTransform4f()
    z = -params["distance_m"]
    middle = t.translate([0, SILL_Y, z + (SILL_NEAR - SILL_FAR) / 2]).rotate([1, 0, 0], -90)
    wood = prints.sill((900, 1400), random)
    paint = {"type": "roughplastic", "diffuse_reflectance": _picture(wood), "alpha": 0.3}
    bars = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": _picture(wood[:200])}}
    upright = t.translate([params["bar_m"], 0.05, z - FRAME_BEHIND]).scale([BAR / 2, 0.2, 0.012])
    across = t.translate([0, SILL_Y + 0.006, z - FRAME_BEHIND]).scale([0.4, 0.006, 0.014])
    return {
        "sill": _sheet(middle, 0.7, SILL_NEAR + SILL_FAR, {"type": "twosided", "bsdf": paint}),
        "upright": {"type": "cube", "to_world": upright, "bsdf": bars},
        "rail": {"type": "cube", "to_world": across, "bsdf": bars},
    }


def _lights(params: dict[str, Any]) -> dict[str, Any]:
    """Daylight from the garden and from a window aside; a lamp, as bright for the label from any side."""
    t = mi.ScalarTransform4f()
    random = np.random.default_rng([86, params["garden_seed"]])
    z = -params["distance_m"]
    garden = _sheet(t.translate([0, 0.19, z - GARDEN_BEHIND]), *GARDEN_SIZE, {"type": "diffuse", "reflectance": 0.0})
    daylight = GARDEN_RADIANCE * prints.garden((216, 315), GARDEN_SMOOTHED_M / GARDEN_SIZE[0] * 315, random)
    face = np.array([params["aside_m"], 0.0, z])
    azimuth = np.radians(params["lamp_azimuth_deg"])
    away = np.array([LAMP_AWAY * np.sin(azimuth), LAMP_UP, LAMP_AWAY * np.cos(azimuth)])
    distance = float(np.linalg.norm(away))
    radiance = LAMP_IRRADIANCE * distance**2 / (LAMP_SIZE**2 * away[2] / distance)
    aim = t.look_at(origin=(face + away).tolist(), target=face.tolist(), up=[0, 1, 0])
    side = -np.sign(azimuth) * 1.0
    other = t.look_at(origin=[side, 0.45, z + 0.60], target=face.tolist(), up=[0, 1, 0])
    aside = _sheet(other, *ASIDE_SIZE, {"type": "diffuse", "reflectance": 0.0})
    lamp = _sheet(aim, LAMP_SIZE, LAMP_SIZE, {"type": "diffuse", "reflectance": 0.0})
    return {
        "garden": {**garden, "emitter": {"type": "area", "radiance": _picture(daylight), "sampling_weight": SELDOM}},
        "aside": {**aside, "emitter": {"type": "area", "radiance": ASIDE_RADIANCE}},
        "lamp": {**lamp, "emitter": {"type": "area", "radiance": float(radiance)}},
        "room": {"type": "constant", "radiance": ROOM_RADIANCE, "sampling_weight": SELDOM},
    }


def _sheet(pose: Any, width: float, height: float, bsdf: dict[str, Any]) -> dict[str, Any]:
    size = mi.ScalarTransform4f().scale([width / 2, height / 2, 1])
    return {"type": "rectangle", "to_world": pose @ size, "bsdf": bsdf}


def _picture(values: np.ndarray) -> dict[str, Any]:
    rows = np.ascontiguousarray(values[::-1], dtype=np.float32)  # a bitmap begins at v = 0
    return {"type": "bitmap", "bitmap": mi.Bitmap(rows), "raw": True, "wrap_mode": "clamp"}
