"""A pebble lies on a beach of smaller ones in sand, under a low sun and a clear sky, dry or wet.

World frame: millimetres, x right, y up, z towards the lens, looking down by 55 degrees; the sand is y = 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import stones
from solids import Body, grid, joined
from surfaces import cloudy, glossy, matte, mesh, texture

SUN, SKY = 5.5, 1.0  # W m^-2 across its rays, W m^-2 sr^-1
WET, FILM = 0.6, 0.3  # what water leaves of a reflectance, and how rough its film is
BED_MM, SAND_MM = (84.0, 76.0), (420.0, 420.0)  # half the sides of the strewn part, the sides of the sand
SAND_TEXEL_MM = 0.2
PEBBLE_MM = (19.0, 9.0, 13.0)
SIZES_MM = ((8.0, 11.0, 70), (5.5, 8.0, 160), (3.0, 5.5, 700))  # half lengths, and how many are tried


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (millimetres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1907, int(params["seed"])])
    wet = bool(params["wet"])
    pictures = {kind: stones.picture(kind, random) for kind in stones.KINDS}
    skins = {kind: _skin(picture, wet=wet) for kind, picture in pictures.items()}
    rest = float(params["rest_mm"])  # on the way to the lens, so that the pebble stays in the middle of the frame
    centre = np.array([random.uniform(-4, 4), rest, rest / np.tan(np.radians(55)) + params["nearer_mm"]])
    turn, tilt = float(params["turn_deg"]), 6 * random.standard_normal()
    body = stones.stone(centre + np.array([0, 9, 0]), PEBBLE_MM, turn, tilt, random, fine=True)
    scene = {"type": "scene", "pebble": mesh("pebble", body, skins[params["kind"]])}
    beach = _strewn(centre, random)
    cobble = (15 + 0.4 * rest, rest + 1, 11 + 0.4 * rest)
    under = stones.KINDS[stones.KINDS.index(params["kind"]) - 1]
    beach[under].append(stones.stone(centre * [1, 0, 1], cobble, turn + 20, 0, random, steps=(60, 90)))
    for kind, bodies in beach.items():
        scene[f"beach_{kind}"] = mesh(f"beach_{kind}", joined(bodies), skins[kind])
    scene["sand"] = mesh("sand", _ground(), _skin(_sand(random), wet=wet), smooth=False)
    azimuth, height = np.radians([float(params["sun_azimuth_deg"]), float(params["sun_height_deg"])])
    towards = [np.cos(height) * np.sin(azimuth), np.sin(height), np.cos(height) * np.cos(azimuth)]
    return scene | {
        "sun": {"type": "directional", "direction": [-float(x) for x in towards], "irradiance": SUN},
        "sky": {"type": "constant", "radiance": SKY},
    }


def _strewn(centre: np.ndarray, random: np.random.Generator) -> dict[str, list[Body]]:
    """Stones by kind round the pebble: large ones first, none within another, each a third in the sand."""
    bodies: dict[str, list[Body]] = {kind: [] for kind in stones.KINDS}
    taken = np.array([[centre[0], centre[2], 14.0]])  # x, z, half length
    for low, high, tries in SIZES_MM:
        for _ in range(tries):
            half = random.uniform(low, high)
            x, z = (random.uniform(-side, side) for side in BED_MM)
            near = np.hypot(taken[:, 0] - x, taken[:, 1] - z) < 0.86 * (taken[:, 2] + half)
            if near.any():
                continue
            taken = np.concatenate([taken, [[x, z, half]]])
            kind = stones.KINDS[random.integers(len(stones.KINDS))]
            radii = half * np.array([1.0, random.uniform(0.4, 0.62), random.uniform(0.7, 0.95)])
            turn, tilt = random.uniform(-180, 180), 9 * random.standard_normal()
            bodies[kind].append(stones.stone((x, 0.35 * radii[1], z), radii, turn, tilt, random))
    return bodies


def _skin(picture: np.ndarray, *, wet: bool) -> dict[str, Any]:
    """Dry stone is matt; water darkens it, since light is caught under its film, and gives it highlights."""
    return glossy(texture(WET * picture), FILM, ior=1.33) if wet else matte(texture(picture))


def _ground() -> Body:
    wide, deep = (side / 2 for side in SAND_MM)
    return grid([[(-wide, 0, deep), (wide, 0, deep)], [(-wide, 0, -deep), (wide, 0, -deep)]])


def _sand(random: np.random.Generator) -> np.ndarray:
    """Grains of quartz, shell and dark minerals, in drifts."""
    shape = tuple(round(side / SAND_TEXEL_MM) for side in reversed(SAND_MM))
    grains = random.choice([0.09, 0.24, 0.33, 0.42, 0.62], p=[0.12, 0.28, 0.3, 0.22, 0.08], size=shape)
    drifts = 1 + 0.16 * cloudy((shape[0], shape[1]), 14, 4, random)
    return np.clip(grains * drifts, 0.04, 0.7).astype(np.float32)
