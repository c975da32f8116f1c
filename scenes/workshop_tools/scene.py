"""Tools on a workbench: an engraved steel rule, a spanner behind it, screws, a pencil, shavings.

World frame: millimetres, x right, y up, z towards the lens, which looks down by 40 degrees; bench at y = 0.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
from solids import Body, box, grid, joined, placed, turning
from surfaces import cloudy, glossy, matte, mesh, noise, panel, texture, tones

import tools

RULE_MM, THICK, RULE_TEXEL = (150.0, 25.0), 1.0, 0.07  # a pixel sees 0.3 mm
WINDOW, LAMP, ROOM = 1.6, 7.0, 0.18  # W m^-2 sr^-1
BENCH_MM, TILE_TEXELS = 160.0, 1100
# Screws that lie about: x, z, how turned; the rule is kept free.
SCREWS = ((-34, 38, 20), (-18, 47, 130), (30, 36, -40), (44, 50, 75), (4, 50, 10), (-48, -34, 60), (-58, 22, -75))
CURLS = ((58, 34), (-50, 30), (20, -112), (-80, -60), (74, -20), (-12, -130))


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (millimetres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1851, int(params["seed"])])
    steel, rust = params["steel"], params["rust"]
    turn, (wide, deep) = turning([0, 1, 0], params["turn_deg"]), RULE_MM
    aside = np.array([random.uniform(-45, 45), 0.0, 0.0])  # which part of the scale is seen
    at = turn @ aside + np.array([0, 0, params["nearer_mm"]])
    top = grid([[(x, THICK + 0.02, z) for x in (-wide / 2, wide / 2)] for z in (deep / 2, -deep / 2)])
    edge = box((-wide / 2, 0.0, -deep / 2), (wide / 2, THICK, deep / 2), tone=steel)
    metal, alpha = tools.rule_picture(RULE_MM, RULE_TEXEL, steel=steel, rust=rust, random=random)
    engraved = _steel(texture(metal), texture(alpha))
    away = [random.choice([-52, 52]) + random.uniform(-6, 6), 5.2, -36]
    spanner = placed(tools.spanner(), away, turn=turning([0, 1, 0], params["spanner_turn_deg"]))
    lying = turning([0, 1, 0], random.uniform(-28, 28))
    aside_mm = random.uniform(-30, 30)
    handle, blade = (placed(part, [aside_mm, 13.2, -78], turn=lying) for part in tools.screwdriver())
    pencil_at, pencil_turn = [random.uniform(-10, 25), 4.0, 66], turning([0, 1, 0], random.uniform(-20, 20))
    pencil = placed(tools.pencil(), pencil_at, turn=pencil_turn)
    planks = texture(_planks(params["wood"], random), repeat=(4, 4))
    return {
        "type": "scene",
        "rule": mesh("rule", placed(top, at, turn=turn), engraved, smooth=False),
        "edge": mesh("edge", placed(edge, at, turn=turn), _steel(steel, 0.4), smooth=False),
        "spanner": mesh("spanner", spanner, _steel(steel * (1 - 0.35 * rust), 0.42)),
        "handle": mesh("handle", handle, _varnished(0.35)),
        "blade": mesh("blade", blade, _steel(steel, 0.35)),
        "screws": mesh("screws", _screws(params, random), _steel(0.62, 0.35)),
        "pencil": mesh("pencil", pencil, _varnished(0.45), smooth=False),
        "shavings": mesh("shavings", _shavings(params["wood"], random), matte(tones())),
        "bench": mesh("bench", _bench(), glossy(planks, 0.42), smooth=False),
        **_lights(params),
    }


def _steel(colour: Any, alpha: Any) -> Any:
    """Principled metal, whose light paths share what they find, unlike those of a conductor."""
    rough = alpha if isinstance(alpha, dict) else alpha**0.5
    made = {"type": "principled", "metallic": 1.0, "base_color": colour, "roughness": rough}
    return mi.load_dict({"type": "twosided", "bsdf": made})


def _varnished(rough: float) -> Any:
    """A coat of index 1.5 over the tones of a body's vertices."""
    made = {"type": "principled", "base_color": tones(), "roughness": rough, "specular": 0.5}
    return mi.load_dict({"type": "twosided", "bsdf": made})


def _screws(params: dict[str, Any], random: np.random.Generator) -> Body:
    made = []
    for x, z, angle in SCREWS:
        at = [x + random.normal(0, 1.5), 1.6, z + random.normal(0, 1.5) + params["nearer_mm"]]
        turn = turning([0, 1, 0], angle + random.normal(0, 15)) @ turning([0, 0, 1], 86)
        made.append(placed(tools.screw(), at, turn=turn))
    return joined(made)


def _shavings(wood: float, random: np.random.Generator) -> Body:
    made = []
    for x, z in CURLS:
        turn = turning([0, 1, 0], random.uniform(0, 180))
        body = tools.shaving(min(1.5 * wood, 0.6), random)
        made.append(placed(body, [x + random.normal(0, 3), 0.3, z + random.normal(0, 3)], turn=turn))
    return joined(made)


def _bench() -> Body:
    half = 2 * BENCH_MM
    return grid([[(x, 0, z - 120) for x in (-half, half)] for z in (half, -half)])


def _planks(wood: float, random: np.random.Generator) -> np.ndarray:
    """Two planks, 80 mm wide, along x: grain, pores, scratches, a ring of oil."""
    n = TILE_TEXELS
    y = np.arange(n)[:, None] / n
    waves = np.sin(2 * np.pi * (22 * y + 1.3 * cloudy((n, n), 2, 3, random)))
    fibres = noise((n, n), (n / 2.5, 18), random)
    grey = wood * np.where(y < 0.5, 1.0, random.uniform(0.8, 1.2)) * (1 + 0.13 * waves + 0.16 * fibres)
    pores = noise((n, n), (n / 3, 40), random) > 0.72
    grey = np.where(pores, 0.55 * grey, grey)
    for _ in range(14):
        at, length = random.uniform(0.06, 0.94, 2), random.uniform(0.02, 0.10)
        a = random.uniform(0, np.pi)
        steps = (at + length * np.linspace(-0.5, 0.5, 200)[:, None] * [np.cos(a), np.sin(a)]) * n
        row, column = np.clip(steps.astype(int), 0, n - 2).T
        grey[row, column] *= 0.6
    seam = np.minimum(np.abs(y - 0.5), np.minimum(y, 1 - y)) * n < 3
    ends = np.minimum(np.arange(n), n - 1 - np.arange(n))[None, :] < 3
    return np.clip(np.where(seam | ends, 0.25 * grey, grey), 0.02, 0.65)


def _lights(params: dict[str, Any]) -> dict[str, Any]:
    azimuth = np.radians(params["lamp_azimuth_deg"])
    middle = np.array([0.0, 0.0, 0.0])
    lamp = 520 * np.array([0.8 * np.sin(azimuth), 0.65, 0.8 * np.cos(azimuth)])
    return {
        "window": panel((120, 620, -760), middle, (900, 700), WINDOW),  # where polished steel mirrors it
        "lamp": panel(lamp, middle, (190, 190), LAMP),
        "room": {"type": "constant", "radiance": ROOM},
    }
