"""An unglazed vase and two eggs on a sweep of matt paper: tone on tone, hardly any texture.

World frame: metres, x right, y up, z towards the lens. The vase stands at the origin when it is 0.6 m away;
for another distance all but the lens moves along the lens's axis.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
from patterns import clay, paper, shell
from shapes import egg, matte, outline, panel, sweep, turned

AXIS = np.array([0.0, -0.1219, -0.9925])  # where the lens looks
MIDDLE = (0.0, 0.034, 0.0)  # of the vase: 0.6 m from the lens as it is drawn
DRAWN_AT_M = 0.6
TEXEL_MM = 0.11  # a pixel sees 0.29 mm to 0.37 mm

# Outlines of the vases: (radius, height) in mm from the foot up outside, over the lip and down inside.
FORMS = {
    "bottle": [(0, 0), (15, 0), (17.5, 2), (22, 12), (24, 24), (21, 36), (12, 46), (7.5, 54), (7.2, 62),
               (9.5, 69), (8.6, 69.4), (6.0, 62), (6.2, 54), (10, 46)],
    "ovoid": [(0, 0), (13, 0), (15.5, 2), (21.5, 14), (26, 30), (26.5, 43), (22, 55), (14.5, 62), (13.2, 65),
              (14.6, 68), (13.6, 68.4), (12, 65), (13, 62), (20, 55)],
    "jar": [(0, 0), (18, 0), (20, 1.5), (22.5, 12), (23.2, 28), (23.0, 44), (21, 54), (18.4, 59), (18.6, 63),
            (19.6, 65), (18.4, 65.3), (17.2, 62), (17.2, 59), (19.6, 54)],
}  # fmt: skip
VASE, EGG, PAPER = 0.52, 0.60, 0.50  # mean diffuse reflectances

# Two soft boxes: distance along the ground, height above the vase's middle, side (m), and the irradiance
# (W m^-2) of direct light that each gives an upright cylinder, mean over its width as the lens sees it.
KEY = (0.80, 0.42, 0.45, 1.0)
FILL = (1.10, 0.60, 0.50, 0.45)
APART_DEG = 75.0  # the fill comes from the key's other side, so that neither stands before the other


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([71, params["clay_seed"]])
    shift = AXIS * (params["distance_m"] - DRAWN_AT_M)
    contrast = params["grain_contrast"]

    def at(x: float, y: float, z: float) -> Any:
        return mi.ScalarTransform4f().translate(np.add(shift, [x, y, z]).tolist())

    profile = outline(FORMS[params["form"]], 12)
    around, along = 2 * np.pi * 0.022, np.linalg.norm(np.diff(profile, axis=0), axis=1).sum()
    size = round(along * 1e3 / TEXEL_MM), round(around * 1e3 / TEXEL_MM)
    grain = clay(size, TEXEL_MM, params["grain_mm"], random)
    scene = {
        "type": "scene",
        "vase": turned("vase", profile, at(0.004, 0.0, 0.0), matte(VASE * (1 + contrast * grain))),
        "sweep": _sweep(at, contrast, random),
        **_lights(shift, params["light_azimuth_deg"]),
    }
    eggs = ((-0.043, 0.058, 25.0), (0.046, -0.075, -40.0))
    for number, (x, z, yaw) in enumerate(eggs):
        pores = shell((600, 900), 110, random)
        width = 0.0425 + 0.0015 * number
        lying = at(x, width / 2 - 0.0003, z).rotate([0, 1, 0], yaw).rotate([0, 0, 1], 88)
        bsdf = matte(EGG * (1 + 0.7 * contrast * pores))
        scene[f"egg_{number}"] = turned(f"egg_{number}", egg(0.056, width), lying, bsdf)
    return scene


def _sweep(at: Any, contrast: float, random: np.random.Generator) -> mi.Mesh:
    """Paper from 0.18 m before the vase to the bend 0.15 m behind it, then upwards."""
    tooth = paper((1500, 1500), 700, random)
    bsdf = matte(PAPER * (1 + 0.3 * contrast * tooth))
    return sweep("sweep", 0.33, 0.16, 0.6, 0.8, at(0.0, 0.0, 0.18), bsdf)


def _lights(shift: np.ndarray, azimuth_deg: float) -> dict[str, Any]:
    middle = shift + MIDDLE
    other = azimuth_deg - APART_DEG if azimuth_deg >= 0 else azimuth_deg + APART_DEG
    return {"key": _softbox(middle, azimuth_deg, *KEY), "fill": _softbox(middle, other, *FILL)}


def _softbox(
    middle: np.ndarray, azimuth_deg: float, away_m: float, up_m: float, size_m: float, irradiance: float
) -> dict[str, Any]:
    """A soft box, set so that the vase has the same light from any azimuth.

    A surface that faces it has E = L A/d²; an upright cylinder, in the mean over its width as seen from the
    front, E cos(elevation) ((pi - |a|) cos a + sin |a|)/4.
    """
    azimuth = np.radians(azimuth_deg)
    to_box = np.array([away_m * np.sin(azimuth), up_m, away_m * np.cos(azimuth)])
    squared = float(to_box @ to_box)
    share = ((np.pi - abs(azimuth)) * np.cos(azimuth) + np.sin(abs(azimuth))) / 4
    radiance = irradiance * squared / size_m**2 / (away_m / np.sqrt(squared) * share)
    return panel((middle + to_box).tolist(), middle.tolist(), size_m, radiance)
