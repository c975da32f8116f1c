"""A stained section of cardiac muscle under a microscope: light from below, and a ring of lamps above.

World frame: millimetres, x right, y up in the picture, z towards the objective; the section lies
``height_um`` over the origin. It is two sheets that let light straight through, less by their absorbance;
the upper one throws a little of the light from above back.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
from fibres import SIZE_UM, run
from stain import layers

from saf_gen.render.meshes import make_mesh

MM_PER_UM = 1e-3
BELOW_UM = 2.0  # from the upper sheet to the lower
SCATTERED = 0.2  # of the light from above, by unit absorbance
GRID = (34, 48)  # quadrilaterals of a sheet

LAMP_MM, LAMP_RADIUS_MM, LAMP_RADIANCE = -2.0, 4.0, 52.5  # opal glass; W m^-2 sr^-1
RING_MM, RING_RADIUS_MM, PANEL_RADIUS_MM, RING_RADIANCE = 12.0, 9.0, 2.6, 250.0


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (millimetres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1664, int(params["seed"])])
    fibres = run(params["fibre_um"], np.radians(params["turn_deg"]), random)
    upper, lower = (params["stain"] * a for a in layers(fibres, params["sarcomere_um"], random))
    height = _relief(params, random)
    return {
        "type": "scene",
        "section": _sheet("section", height, _stained(upper, SCATTERED)),
        "section_below": _sheet("section_below", height - BELOW_UM, _stained(lower, 0.0)),
        "lamp": _disc((0, 0, LAMP_MM), LAMP_RADIUS_MM, LAMP_RADIANCE),
        **_ring(),
    }


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """The stage creeps to and fro as a hand turns it, and sinks by a tenth of its way."""
    way, azimuth = params["drift_um"] * 1e-6, np.radians(params["drift_azimuth_deg"])
    keyframes = []
    for time_s, share, aside in ((0, -0.5, 0), (0.2, -0.35, 0.1), (0.5, 0, 0), (0.7, 0.3, -0.15), (1, 0.5, 0)):
        c, s = np.cos(azimuth), np.sin(azimuth)
        shift = [way * (share * c - aside * s), way * (share * s + aside * c), -0.1 * way * share]
        keyframes.append({"time_s": float(time_s), "translate_m": [float(x) for x in shift]})
    return {name: {"keyframes": keyframes} for name in ("section", "section_below")}


def _relief(params: dict[str, Any], random: np.random.Generator) -> np.ndarray:
    """Heights (µm) of the sheets' corners: tilted, and wavy as a section that was stretched on its slide."""
    y, x = (np.linspace(-0.5, 0.5, n + 1) * size for n, size in zip(GRID, SIZE_UM[::-1], strict=True))
    x, y = np.meshgrid(x, y)
    azimuth = random.uniform(0, 2 * np.pi)
    slope = np.tan(np.radians(params["tilt_deg"])) * (np.cos(azimuth) * x + np.sin(azimuth) * y)
    wave = np.zeros_like(x)
    for length, share in ((300.0, 0.6), (180.0, 0.3), (95.0, 0.15)):
        towards, phase = random.uniform(0, 2 * np.pi, 2)
        wave += share * np.sin(2 * np.pi / length * (np.cos(towards) * x + np.sin(towards) * y) + phase)
    return params["height_um"] + slope + params["relief_um"] * wave


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
    back = {"type": "diffuse", "reflectance": 0.9}
    return {"type": "blendbsdf", "weight": share, "through": through, "back": back}


def _picture(values: np.ndarray) -> dict[str, Any]:
    """Texture of shares 0...1; the first row lies at the bottom."""
    texels = np.ascontiguousarray(values, dtype=np.float32)
    return {"type": "bitmap", "bitmap": mi.Bitmap(texels), "raw": True, "wrap_mode": "clamp"}


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


def _sheet(name: str, height_um: np.ndarray, bsdf: dict[str, Any]) -> mi.Mesh:
    """A sheet of the section's size through these heights (µm), facing up."""
    rows, columns = height_um.shape
    v, u = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    points = np.stack([(u - 0.5) * SIZE_UM[0], (v - 0.5) * SIZE_UM[1], height_um], -1).reshape(-1, 3)
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    above = first + columns
    faces = [np.stack(half, 1) for half in ((first, first + 1, above + 1), (first, above + 1, above))]
    uv = np.stack([u, v], -1)
    return make_mesh(name, points * MM_PER_UM, faces=np.concatenate(faces), bsdf=bsdf, uv=uv)
