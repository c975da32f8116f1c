"""A small scene: a target with a drawn form, texture, place and light, things around it, and a wall behind.

World frame: millimetres, x right, y up; the lens stands at the origin and looks along -z. A layout that is
not ``usable`` is drawn again, by numbers of its own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import layouts
import mitsuba as mi
import movements
import numpy as np
import surfaces
import targets
from sight import Sight, look
from solids import Body
from textures import texture

from saf_gen.render.meshes import make_mesh

CUT = 0.43  # cycles a pixel: the finest detail of a texture as the lens sees it
MAX_TRIES = 30
MIN_CONTRAST, MAX_HIDDEN, MAX_DEPTH = 0.012, 0.4, 5.5  # what usable() asks for
ROUGHNESS = {"satin": 0.3, "glossy": 0.12}
REFLECTANCE = (0.015, 0.9)
OTHERS = ("noise", "dead_leaves", "weave", "bark", "print", "foliage", "paper")  # textures of what is not the target


class Layout(NamedTuple):
    """A target, what is around it, and reflectances, by the names of the parts that show them."""

    target: layouts.Target
    others: layouts.Others
    pictures: dict[str, np.ndarray]

    @property
    def contrast(self) -> float:
        """SD over mean of the reflectance of the target."""
        picture = self.pictures["target"]
        return float(picture.std() / picture.mean())


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (mm, W m^-2 sr^-1) without sensor and integrator."""
    sight = look(params["lens"], params["place_deg"])
    layout, _ = draw(params, sight)
    skins = {name: surfaces.texture(picture) for name, picture in layout.pictures.items()}
    rough = ROUGHNESS.get(params["gloss"])
    parts = {
        "target": (layout.target.body(sight), surfaces.glossy(skins["target"], rough) if rough else None),
        "second": (layout.others.second, None),
        "clutter": (layout.others.clutter, None),
        "things": (layout.others.things, surfaces.glossy(skins["things"], 0.25)),
        "wall": (layouts.wall(params, sight)[0], None),
    }
    meshes = {name: _mesh(name, body, coat or surfaces.matte(skins[name])) for name, (body, coat) in parts.items()}
    return {"type": "scene", **meshes, **_lamps(params, sight)}


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """What moves, by the names of the parts."""
    sight = look(params["lens"], params["place_deg"])
    return movements.movements(params, sight, draw(params, sight)[0].target)


def tries(params: dict[str, Any]) -> int:
    """How many layouts of a member were drawn until one was usable."""
    return draw(params, look(params["lens"], params["place_deg"]))[1]


def draw(params: dict[str, Any], sight: Sight) -> tuple[Layout, int]:
    """The first usable layout, and its number from 1. Raises ValueError if there is none among MAX_TRIES."""
    for number in range(1, MAX_TRIES + 1):
        layout = _draw(params, sight, np.random.default_rng([4101, int(params["seed"]), number]))
        if usable(layout):
            return layout, number
    raise ValueError(f"none of {MAX_TRIES} layouts is usable")


def usable(layout: Layout) -> bool:
    """By what is there, and by no measure of focus: contrast, hidden share, depth in half depths of focus."""
    seen = layout.contrast >= MIN_CONTRAST and layout.others.hidden <= MAX_HIDDEN
    return seen and layout.target.depth <= MAX_DEPTH


def _draw(params: dict[str, Any], sight: Sight, random: np.random.Generator) -> Layout:
    target = targets.target(params, sight, random)
    others = layouts.others(params, sight, target, random)
    others = others._replace(hidden=max(others.hidden, targets.notched(target)))
    form = {"feature_px": params["feature_px"], "slope": params["slope"], "narrowed": target.narrowed}
    picture = texture(params["texture"], target.reach, **form, cut=CUT, random=random)
    specks = params["texture"] == "specks"  # their contrast is a dark ground
    tone = random.uniform(0.04, 0.10) if specks else float(np.exp(random.uniform(*np.log([0.06, 0.6]))))
    pictures = {"target": reflectance(picture, tone, params["contrast"])}
    for name, side in {"second": 100.0, "clutter": 60.0, "things": 60.0}.items():
        pictures[name] = _other(OTHERS[random.integers(len(OTHERS))], side, random)
    pictures["wall"] = _other(params["wall_texture"], layouts.wall(params, sight)[1], random, tone=params["wall_tone"])
    return Layout(target, others, pictures)


def _other(kind: str, side_px: float, random: np.random.Generator, *, tone: float | None = None) -> np.ndarray:
    """Reflectances of what is not the target."""
    feature, slope, contrast = random.uniform(3, 12), random.uniform(0.8, 2), random.uniform(0.1, 0.5)
    picture = texture(kind, side_px, feature_px=feature, slope=slope, cut=0.7 * CUT, random=random)
    return reflectance(picture, random.uniform(0.08, 0.6) if tone is None else tone, contrast)


def reflectance(picture: np.ndarray, tone: float, contrast: float) -> np.ndarray:
    """A picture of mean 0 and SD 1 as reflectances, with this contrast or the largest that fits."""
    low, high = REFLECTANCE
    most = min((tone - low) / -float(picture.min()), (high - tone) / float(picture.max()))
    return (tone + min(contrast * tone, most) * picture).astype(np.float32)


def _mesh(name: str, body: Body, bsdf: dict[str, Any]) -> mi.Mesh:
    return make_mesh(name, body.vertices, faces=body.triangles, bsdf=bsdf, uv=body.uv, smooth=True)


def _lamps(params: dict[str, Any], sight: Sight) -> dict[str, Any]:
    """A lamp to one side of the lens, which gives the target about 3 W m^-2, and light from all sides."""
    azimuth, height = np.radians(params["lamp_azimuth_deg"]), np.radians(params["lamp_height_deg"])
    way = np.array([np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth), np.sin(height)])
    place, away = sight.at(0.0, 0.0), 1.4 * sight.focused
    wide = params["lamp_width"] * away
    radiance = 3.0 / (params["lamp_width"] ** 2 * np.sin(height))
    return {
        "lamp": surfaces.panel((place + away * way).tolist(), place.tolist(), (wide, wide), float(radiance)),
        "room": {"type": "constant", "radiance": float(3.0 / np.pi * params["room"])},
    }
