"""A stained blood smear under a microscope: light from below, and a ring of lamps above.

World frame: millimetres, x right, y up in the picture, z towards the objective; the film of cells lies
``height_um`` over the origin, what lies under it is a sheet of its own. Both let light straight through, less
by their absorbance; the film throws a little of that from above back.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
from cells import SIZE_UM, films
from solids import grid
from surfaces import mesh

MM_PER_UM = 1e-3
BELOW_UM = 1.8  # from the film down to what is under it
SCATTERED = 0.05  # of the light from above, by unit absorbance
CELLS = (30, 40)  # quadrilaterals of a sheet
LAMP_MM, LAMP_RADIUS_MM, LAMP_RADIANCE = -3.0, 6.0, 46.6  # opal glass; W m^-2 sr^-1
RING_MM, RING_RADIUS_MM, PANEL_RADIUS_MM, RING_RADIANCE = 3.0, 7.0, 1.2, 480.0


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (millimetres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1879, int(params["seed"])])
    film, below = films(params, random)
    height = _relief(params, random)
    back = {"type": "diffuse", "reflectance": 0.9}
    share = _picture((SCATTERED * film).clip(0, 0.5))
    stained = {"type": "blendbsdf", "weight": share, "through": _clear(film), "back": back}
    return {
        "type": "scene",
        "film": _sheet("film", height, stained),
        "film_below": _sheet("film_below", height - BELOW_UM, _clear(below)),
        "lamp": _disc((0, 0, LAMP_MM), LAMP_RADIUS_MM, LAMP_RADIANCE),
        **_ring(),
    }


def _relief(params: dict[str, Any], random: np.random.Generator) -> np.ndarray:
    """Heights (µm) of the film's corners: tilted, and wavy by a few tenths of a micrometre."""
    y, x = (np.linspace(-0.5, 0.5, n + 1) * size for n, size in zip(CELLS, SIZE_UM[::-1], strict=True))
    x, y = np.meshgrid(x, y)
    azimuth, phase, towards = random.uniform(0, 2 * np.pi, 3)
    slope = np.tan(np.radians(params["tilt_deg"])) * (np.cos(azimuth) * x + np.sin(azimuth) * y)
    wave = np.sin(2 * np.pi / 120.0 * (np.cos(towards) * x + np.sin(towards) * y) + phase)
    return params["height_um"] + slope + params["relief_um"] * wave


def _clear(absorbance: np.ndarray) -> dict[str, Any]:
    """A sheet that lets light straight through."""
    made = {"type": "thindielectric", "int_ior": 1.0, "ext_ior": 1.0}
    return made | {"specular_transmittance": _picture(10.0**-absorbance)}


def _picture(values: np.ndarray) -> dict[str, Any]:
    """Texture of shares 0..1; the first row lies at the bottom."""
    texels = np.ascontiguousarray(values, dtype=np.float32)
    return {"type": "bitmap", "bitmap": mi.Bitmap(texels), "raw": True, "wrap_mode": "clamp"}


def _sheet(name: str, height_um: np.ndarray, bsdf: dict[str, Any]) -> mi.Mesh:
    """A sheet of the film's size through these heights."""
    rows, columns = height_um.shape
    y, x = (np.linspace(-0.5, 0.5, n) * size for n, size in zip((rows, columns), SIZE_UM[::-1], strict=True))
    x, y = np.meshgrid(x, y)
    return mesh(name, grid(MM_PER_UM * np.stack([x, y, height_um], axis=2)), bsdf, smooth=False)


def _disc(at: tuple[float, float, float], radius: float, radiance: float) -> dict[str, Any]:
    """A lamp that faces the film."""
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
