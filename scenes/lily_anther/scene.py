"""A stained section of a lily anther under a microscope: light from below, and a ring of lamps above.

World frame: millimetres, x right, y up in the picture, z towards the objective; the section lies
``height_um`` over the origin. It is two sheets that let light straight through, less by their absorbance;
the upper one throws a little of the light from above back.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
from anatomy import Anther
from solids import grid
from stain import layers
from surfaces import mesh
from view import SIZE_UM, View

MM_PER_UM = 1e-3
BELOW_UM = 5.0  # from the upper sheet to the lower
SCATTERED, RETURNED = 0.2, 0.3  # of the light from above, by unit absorbance; of that, upwards
GRID = (36, 50)  # quadrilaterals of a sheet

LAMP_MM, LAMP_RADIUS_MM, LAMP_RADIANCE = -3.0, 6.0, 46.6  # opal glass; W m^-2 sr^-1
RING_MM, RING_RADIUS_MM, PANEL_RADIUS_MM, RING_RADIANCE = 24.0, 15.0, 4.5, 278.5


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (millimetres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1753, int(params["seed"])])
    anther = Anther(random)
    view = View(np.radians(params["turn_deg"]), (params["offset_x_um"], params["offset_y_um"]))
    upper, lower = (np.float32(params["stain"]) * a for a in layers(anther, view, params, random))
    place = _relief(params, random)
    return {
        "type": "scene",
        "section": _sheet("section", place, 0.0, _stained(upper, SCATTERED)),
        "section_below": _sheet("section_below", place, BELOW_UM, _stained(lower, 0.0)),
        "lamp": _disc((0, 0, LAMP_MM), LAMP_RADIUS_MM, LAMP_RADIANCE),
        **_ring(),
    }


def _relief(params: dict[str, Any], random: np.random.Generator) -> np.ndarray:
    """Points (µm) of the upper sheet: tilted, and wavy as a section that was stretched on its slide."""
    y, x = (np.linspace(-0.5, 0.5, n + 1) * size for n, size in zip(GRID, SIZE_UM[::-1], strict=True))
    x, y = np.meshgrid(x, y)
    azimuth = random.uniform(0, 2 * np.pi)
    slope = np.tan(np.radians(params["tilt_deg"])) * (np.cos(azimuth) * x + np.sin(azimuth) * y)
    wave = np.zeros_like(x)
    for length, share in ((700.0, 0.6), (420.0, 0.3), (230.0, 0.15)):
        towards, phase = random.uniform(0, 2 * np.pi, 2)
        wave += share * np.sin(2 * np.pi / length * (np.cos(towards) * x + np.sin(towards) * y) + phase)
    return np.stack([x, y, params["height_um"] + slope + params["relief_um"] * wave], axis=2)


def _stained(absorbance: np.ndarray, scattered: float) -> dict[str, Any]:
    through = {
        "type": "thindielectric",
        "int_ior": 1.0,
        "ext_ior": 1.0,
        "specular_transmittance": _picture(10.0**-absorbance),
    }
    if scattered == 0:
        return through
    share = _picture((scattered * absorbance).clip(0, 0.5))
    back = {"type": "diffuse", "reflectance": RETURNED}
    return {"type": "blendbsdf", "weight": share, "through": through, "back": back}


def _picture(values: np.ndarray) -> dict[str, Any]:
    """Texture of shares 0...1; the first row lies at the bottom."""
    texels = np.ascontiguousarray(values, dtype=np.float32)
    return {"type": "bitmap", "bitmap": mi.Bitmap(texels), "raw": True, "wrap_mode": "clamp"}


def _sheet(name: str, points_um: np.ndarray, below_um: float, bsdf: dict[str, Any]) -> mi.Mesh:
    """A sheet through these points, so far below them, facing up."""
    return mesh(name, grid((points_um - (0, 0, below_um)) * MM_PER_UM), bsdf, smooth=False)


def _disc(at: tuple[float, float, float], radius: float, radiance: float) -> dict[str, Any]:
    """A lamp that faces the section."""
    pose = mi.ScalarTransform4f().look_at(origin=list(at), target=[0, 0, 0], up=[0, 1, 0.1])
    return {
        "type": "disk",
        "to_world": pose.scale(radius),
        "bsdf": {"type": "diffuse", "reflectance": 0.0},
        "emitter": {"type": "area", "radiance": radiance},
    }


def _ring() -> dict[str, Any]:
    """Eight panels round the objective, out of its view."""
    angle = np.arange(8) * np.pi / 4
    places = RING_RADIUS_MM * np.column_stack([np.cos(angle), np.sin(angle)])
    return {
        f"ring_{k}": _disc((float(x), float(y), RING_MM), PANEL_RADIUS_MM, RING_RADIANCE)
        for k, (x, y) in enumerate(places)
    }
