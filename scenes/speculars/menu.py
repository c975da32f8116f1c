"""The menu: laid paper with type, a border and a crest in embossed foil; pictures have row 0 on top."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter
from surfaces import cloudy, noise, texture
from typeface import Typeface, ink

CARD_M, TEXEL_M = (0.050, 0.056), 0.00007  # a pixel sees 0.27 mm to 0.31 mm of the card
DEEP_M = 0.00016  # of the embossing
DISHES = (
    ("Pea soup", "mint, sourdough, cold butter"), ("Trout", "brown butter, almonds, dill"),
    ("Lamb shoulder", "thyme, white beans, garlic"), ("Beetroot", "goat cheese, walnuts, honey"),
    ("Hake", "leeks, cider, new potatoes"), ("Duck", "cherries, bitter leaves"),
    ("Pumpkin", "sage, rye crumbs, ricotta"), ("Pear tart", "bay leaf, double cream"),
    ("Plum cake", "cinnamon, soured cream"), ("Chocolate", "sea salt, olive oil"),
)  # fmt: skip
TITLES = ("Menu", "Dinner", "Supper", "Winter")


def card(printed: float, foil_rough: float, random: np.random.Generator) -> dict[str, Any]:
    """The card's surface: paper and ink under a relief, and metal where foil was pressed in."""
    columns, rows = (round(side / TEXEL_M) for side in CARD_M)
    shape, scale = (rows, columns), 1 / TEXEL_M
    foil, text = _foil(shape, scale, random), _text(shape, scale, random)
    paper = 0.76 * (1 + 0.03 * cloudy(shape, 14, 4, random) + 0.02 * random.standard_normal(shape))
    laid = 1 + 0.015 * np.sin(2 * np.pi * np.arange(rows) / 11.0)[:, None]
    worn = 1 - 0.12 * random.random(shape)
    grey = np.clip(paper * laid + text * worn * (printed - paper), 0.02, 0.9)
    soft = gaussian_filter(foil, 1.6)
    relief = 0.05 * cloudy(shape, 40, 3, random) + 0.02 * noise(shape, (rows / 4, columns / 4), random) - soft
    alpha = np.clip(foil_rough * (1 + 0.35 * cloudy(shape, 30, 4, random)), 0.06, 0.5)
    dull = 0.72 * (0.5 + 0.5 * cloudy(shape, 25, 4, random)) > 0.62  # where the foil did not take
    metal = {"type": "roughconductor", "distribution": "ggx", "eta": 0.30, "k": 2.6, "alpha": texture(alpha)}
    mixed = {
        "type": "blendbsdf",
        "weight": texture(foil * ~dull),
        "paper": {"type": "diffuse", "reflectance": texture(grey)},
        "foil": metal,
    }
    height = texture(relief * DEEP_M / CARD_M[1])
    return {"type": "twosided", "bsdf": {"type": "bumpmap", "height": height, "bsdf": mixed}}


def _face(name: str) -> Typeface:
    return Typeface(Path(__file__).parent / f"{name}.npz")


def _foil(shape: tuple[int, int], scale: float, random: np.random.Generator) -> np.ndarray:
    """A double border, corners, the title in script, a rule with a lozenge."""
    wide, high = CARD_M
    x = (np.arange(shape[1]) + 0.5)[None, :] / scale - wide / 2
    y = (np.arange(shape[0]) + 0.5)[:, None] / scale
    inset = np.minimum(wide / 2 - np.abs(x), np.minimum(y, high - y))

    def band(distance: np.ndarray, half: float) -> np.ndarray:
        return np.clip((half - np.abs(distance)) * scale + 0.5, 0, 1)

    made = np.maximum(band(inset - 0.0030, 0.00045), band(inset - 0.0044, 0.00016))
    cx, cy = wide / 2 - np.abs(x) - 0.0058, np.minimum(y, high - y) - 0.0058
    bow = np.hypot(cx, cy)
    corner = np.maximum(band(bow - 0.0021, 0.00022), band(bow - 0.0010, 0.00050)) * (bow < 0.0027)
    made = np.maximum(made, corner)
    face = _face("script")
    title = str(random.choice(TITLES))
    size = min(0.0125, 0.034 / face.width(title, size=1.0))
    made = np.maximum(made, ink(face.line(title, (wide / 2, 0.0165), size=size, align="centre"), shape, scale=scale))
    rule = band(y - 0.0215, 0.00014) * (np.abs(x) < 0.016) * (np.abs(x) > 0.0024)
    lozenge = np.clip((0.0013 - np.abs(x) - np.abs(y - 0.0215)) * scale + 0.5, 0, 1)
    return np.maximum(made, np.maximum(rule, lozenge))


def _text(shape: tuple[int, int], scale: float, random: np.random.Generator) -> np.ndarray:
    """Three courses, each a line and what goes with it."""
    face, middle = _face("serif"), CARD_M[0] / 2
    contours = []
    for k, number in enumerate(random.choice(len(DISHES), 3, replace=False)):
        dish, with_it = DISHES[number]
        y = 0.0285 + 0.0098 * k
        contours += face.line(dish, (middle, y), size=0.0043, align="centre", tracking=0.02)
        contours += face.line(with_it, (middle, y + 0.0039), size=0.0026, align="centre")
    return ink(contours, shape, scale=scale)
