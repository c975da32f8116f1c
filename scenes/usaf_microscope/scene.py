"""A USAF-1951 target of chromium on glass under a microscope: light from below, or through the objective.

World frame: millimetres, x right, y up in the picture, z towards the objective; the plate's middle lies
``height_um`` over the origin. What lies on the plate is drawn in micrometres of the plate.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
from chart import chart, specks
from plate import glass, grains, holes, lint

from saf_gen.render.meshes import make_mesh

PLATE_UM = (1500.0, 1260.0)  # wider than the field of 800 µm × 500 µm, turned, blurred and drifted
FILM_UM = 0.3  # of the chromium's face over the glass: more than Mitsuba's rays keep off a surface
CHROMIUM = {"type": "conductor", "eta": 3.18, "k": 3.31}  # at 550 nm: it reflects 0.55
CLEAR, MIRRORED = 0.96, 0.04  # of the glass: let through below, thrown back by its face

MM_PER_UM = 1e-3
LAMP_MM, LAMP_RADIUS_MM, LAMP_RADIANCE = -3.0, 6.0, 58.3  # opal glass; W m^-2 sr^-1
EPI_MM, EPI_RADIUS_MM, EPI_RADIANCE = 40.0, 20.0, 34.95


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (millimetres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1951, int(params["seed"])])
    wear, half = params["wear"], (PLATE_UM[0] / 2, PLATE_UM[1] / 2)
    marks = _turned(chart(), params["turn_deg"]) + np.array([params["offset_x_um"], params["offset_y_um"]])
    marks = np.concatenate([marks, specks(round(110 * wear), half, random)])
    pose = _pose(params)
    film = {"type": "mask", "opacity": _picture(holes(PLATE_UM, wear, random)), "bsdf": CHROMIUM}
    corner = random.choice([-1.0, 1.0], 2)
    return {
        "type": "scene",
        "plate": {"type": "rectangle", "to_world": pose @ _scaled(half), "bsdf": _glass(wear, random)},
        "chrome": _flat("chrome", marks, FILM_UM, pose, film),
        "dust": _solid("dust", grains(round(20 + 90 * wear), half, random), pose, 0.22),
        "lint": _solid("lint", _fibre(corner, random), pose, 0.35),
        "lamp": _lamp(LAMP_MM, LAMP_RADIUS_MM, LAMP_RADIANCE, up=True),
        "epi": _lamp(EPI_MM, EPI_RADIUS_MM, EPI_RADIANCE, up=False),
    }


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """The stage creeps: fast at first, then slower, and sinks by a tenth of its way."""
    way, azimuth = params["drift_um"] * 1e-6, np.radians(params["drift_azimuth_deg"])
    keyframes = []
    for time_s, share in ((0.0, 0.0), (0.25, 0.38), (0.5, 0.66), (0.75, 0.86), (1.0, 1.0)):
        along = way * (share - 0.66)  # nothing is moved at the moment of the card's pose, 0.5 s
        shift = [along * np.cos(azimuth), along * np.sin(azimuth), -0.1 * along]
        keyframes.append({"time_s": time_s, "translate_m": [float(x) for x in shift]})
    return {name: {"keyframes": keyframes} for name in ("plate", "chrome", "dust", "lint")}


def _pose(params: dict[str, Any]) -> Any:
    azimuth = np.radians(params["tilt_azimuth_deg"])
    axis = [float(np.cos(azimuth)), float(np.sin(azimuth)), 0.0]
    t = mi.ScalarTransform4f()
    return t.translate([0, 0, params["height_um"] * MM_PER_UM]).rotate(axis, params["tilt_deg"]).scale(MM_PER_UM)


def _scaled(half: tuple[float, float]) -> Any:
    return mi.ScalarTransform4f().scale([half[0], half[1], 1])


def _turned(quads: np.ndarray, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return quads @ np.array([[c, s], [-s, c]])


def _fibre(corner: np.ndarray, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Lint across one corner of the field."""
    start = corner * (random.uniform(130, 330), random.uniform(60, 170))
    return lint(start, float(np.arctan2(*corner[::-1]) + random.choice([-1, 1]) * random.uniform(0.5, 1.4)), random)


def _picture(values: np.ndarray) -> dict[str, Any]:
    """Texture of shares 0...1; the first row lies at the bottom."""
    texels = np.rint(255 * values.clip(0, 1)).astype(np.uint8)
    return {"type": "bitmap", "bitmap": mi.Bitmap(texels), "raw": True, "wrap_mode": "clamp"}


def _glass(wear: float, random: np.random.Generator) -> dict[str, Any]:
    """Straight through, and a weak reflection that is a little rough: lamps are found with little noise."""
    through = {
        "type": "thindielectric",
        "int_ior": 1.0,
        "ext_ior": 1.0,
        "specular_transmittance": _picture(CLEAR * glass(PLATE_UM, wear, random)),
    }
    back = {"type": "roughconductor", "material": "none", "alpha": 0.1}
    return {"type": "blendbsdf", "weight": MIRRORED, "a": through, "b": back}


def _lamp(z: float, radius: float, radiance: float, *, up: bool) -> dict[str, Any]:
    """A disc of even light that faces the plate; the one above is as if mirrored in."""
    pose = mi.ScalarTransform4f().translate([0, 0, z])
    if not up:
        pose = pose.rotate([1, 0, 0], 180)
    return {
        "type": "disk",
        "to_world": pose.scale(radius),
        "bsdf": {"type": "diffuse", "reflectance": 0.0},
        "emitter": {"type": "area", "radiance": radiance},
    }


def _flat(name: str, quads: np.ndarray, z: float, pose: Any, bsdf: dict[str, Any]) -> mi.Mesh:
    """Quadrilaterals at a height over the plate, as one mesh that wears a picture of the plate's size."""
    count = len(quads)
    flat = quads.reshape(-1, 2)
    halves = np.array([[0, 1, 2], [0, 2, 3]])
    faces = (4 * np.arange(count)[:, None, None] + halves).reshape(-1, 3)
    points = np.column_stack([flat, np.full(4 * count, z)])
    return _mesh(name, points, faces, pose, bsdf, uv=flat / PLATE_UM + 0.5)


def _solid(name: str, body: tuple[np.ndarray, np.ndarray], pose: Any, reflectance: float) -> mi.Mesh:
    bsdf = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": reflectance}}
    return _mesh(name, *body, pose, bsdf)


def _mesh(name: str, points: np.ndarray, faces: np.ndarray, pose: Any, bsdf: dict[str, Any], uv: Any = None) -> mi.Mesh:
    matrix = np.array(pose.matrix, dtype=np.float64)
    placed = points @ matrix[:3, :3].T + matrix[:3, 3]
    return make_mesh(name, placed, faces=faces, bsdf=bsdf, uv=uv, smooth=uv is None)
