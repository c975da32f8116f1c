"""A thin section of rock under a microscope: light from below through a polariser, a ring above.

World frame: millimetres, x right, y up in the picture, z towards the objective; the section lies
``height_um`` over the origin. It is two sheets that let light straight through; the upper one throws some of
that from above back.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
from minerals import SIZE_UM
from rock import layers
from solids import grid
from surfaces import mesh

BELOW_UM = 12.0  # from the upper sheet to the lower
RETURNED = 0.3  # of the light from above that does not pass, upwards
LAMP_MM, LAMP_RADIUS_MM, LAMP_RADIANCE = -4.0, 6.0, 60.0  # opal glass; W m^-2 sr^-1
RING_MM, RING_RADIUS_MM, PANEL_RADIUS_MM, RING_RADIANCE = 22.0, 15.0, 4.0, 200.0


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (millimetres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1858, int(params["seed"])])
    upper, lower, back = layers(params, random)
    through, thrown = _clear(upper), {"type": "diffuse", "reflectance": RETURNED}
    stained = {"type": "blendbsdf", "weight": _picture(back), "through": through, "back": thrown}
    return {
        "type": "scene",
        "section": _sheet("section", 0.0, params, stained),
        "section_below": _sheet("section_below", -BELOW_UM, params, _clear(lower)),
        "lamp": _disc((0, 0, LAMP_MM), LAMP_RADIUS_MM, LAMP_RADIANCE),
        **_ring(),
    }


def _clear(share: np.ndarray) -> dict[str, Any]:
    """A sheet that lets this share of the light straight through."""
    made = {"type": "thindielectric", "int_ior": 1.0, "ext_ior": 1.0}
    return made | {"specular_transmittance": _picture(share)}


def _picture(values: np.ndarray) -> dict[str, Any]:
    """Texture of shares 0..1; the first row lies at the bottom."""
    texels = np.ascontiguousarray(values, dtype=np.float32)
    return {"type": "bitmap", "bitmap": mi.Bitmap(texels), "raw": True, "wrap_mode": "clamp"}


def _sheet(name: str, z_um: float, params: dict[str, Any], bsdf: dict[str, Any]) -> mi.Mesh:
    """A tilted rectangle of the section's size."""
    x, y = (np.array([-0.5, 0.5]) * size * 1e-3 for size in SIZE_UM)
    x, y = np.meshgrid(x, y)
    azimuth, slope = params["seed"], np.tan(np.radians(params["tilt_deg"]))
    z = 1e-3 * (params["height_um"] + z_um) + slope * (np.cos(azimuth) * x + np.sin(azimuth) * y)
    return mesh(name, grid(np.stack([x, y, z], axis=2)), bsdf, smooth=False)


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
    """Six panels round the objective, out of its view."""
    angle = np.arange(6) * np.pi / 3
    places = RING_RADIUS_MM * np.column_stack([np.cos(angle), np.sin(angle)])
    return {
        f"ring_{k}": _disc((float(x), float(y), RING_MM), PANEL_RADIUS_MM, RING_RADIANCE)
        for k, (x, y) in enumerate(places)
    }
