"""What things are made of: steel, silver, brass, linen, card."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import mitsuba as mi
import numpy as np
from letters import drawn, lines
from meshes import texture

CARD_M = (0.046, 0.034)
TEXEL_M = 0.00008  # a pixel sees 0.24 mm to 0.30 mm of the card
DISHES = (
    "SOUP OF PEAS",
    "TROUT IN BUTTER",
    "LAMB WITH THYME",
    "BEANS AND MINT",
    "PEAR TART",
    "COFFEE 3.50",
    "GOAT CHEESE",
    "RYE BREAD",
    "PLUM CAKE",
    "HAKE AND LEEK",
    "BEETROOT 4.20",
    "WALNUT SALAD",
)
# Index and absorption at 555 nm.
METALS = {"steel": (2.6, 3.6), "silver": (0.13, 3.4), "brass": (0.6, 2.5)}


def metal(kind: str, rough: np.ndarray | float, across: float | None = None) -> Any:
    """A metal, loaded, with a roughness or a picture of it; ``across``: roughness along v, if brushed."""
    eta, k = METALS[kind]
    words: dict[str, Any] = {"type": "roughconductor", "distribution": "ggx", "eta": eta, "k": k}
    alpha = texture(rough) if isinstance(rough, np.ndarray) else rough
    words |= {"alpha": alpha} if across is None else {"alpha_u": alpha, "alpha_v": across}
    return mi.load_dict({"type": "twosided", "bsdf": words})


def handled(rough: float, random: np.random.Generator) -> np.ndarray:
    """Roughness of polished metal that has been handled: hairline scratches, smears, a few water spots."""
    n = 384
    picture = np.full((n, n), rough)
    y, x = np.mgrid[0:n, 0:n] / n
    for _ in range(9):
        cx, cy, r = random.uniform(0, 1), random.uniform(0, 1), random.uniform(0.02, 0.09)
        ridges = 0.5 + 0.5 * np.sin(70 * np.hypot(x - cx + 0.1, y - cy))
        picture += 0.10 * ridges * np.exp(-(((x - cx) / r) ** 2) - ((y - cy) / r) ** 2)
    for _ in range(14):
        cx, cy, r = random.uniform(0, 1), random.uniform(0, 1), random.uniform(0.006, 0.02)
        picture[np.abs(np.hypot(x - cx, y - cy) - r) < 0.002] += 0.12
    for _ in range(60):
        cx, cy, a = random.uniform(0, 1), random.uniform(0, 1), random.uniform(0, np.pi)
        along, off = (x - cx) * np.cos(a) + (y - cy) * np.sin(a), (y - cy) * np.cos(a) - (x - cx) * np.sin(a)
        picture[(np.abs(off) < 0.0015) & (np.abs(along) < 0.12)] += 0.08
    return np.clip(picture, 0.03, 0.35)


def linen(random: np.random.Generator) -> Any:
    """A dark table-cloth, loaded: plain weave of uneven threads of 0.8 mm, 0.10 m a repeat."""
    n, threads = 800, 125
    at = np.arange(n) / n
    warp, weft = (1 + 0.22 * random.standard_normal(threads) for _ in range(2))
    k = (at * threads).astype(int)
    round_ = np.abs(np.sin(np.pi * at * threads))
    over = ((k[:, None] + k[None, :]) % 2).astype(bool)
    tone = np.where(
        over, warp[k][None, :] * round_[None, :] ** 0.5, weft[k][:, None] * round_[:, None] ** 0.5
    )
    tone *= 1 + 0.12 * random.standard_normal((n, n))
    cloth = np.clip(0.11 * (0.35 + 0.65 * tone), 0.02, 0.4)
    bsdf = {"type": "diffuse", "reflectance": texture(cloth, (14, 14))}
    return mi.load_dict({"type": "twosided", "bsdf": bsdf})


def card(ink: float, random: np.random.Generator) -> Any:
    """Uncoated card, loaded, printed with a menu: a border of lozenges, a dark band with the title and
    two sprigs, five lines."""
    columns, rows = (round(side / TEXEL_M) for side in CARD_M)
    x = (np.arange(columns) + 0.5 - columns / 2) * TEXEL_M * 1e3  # mm
    y = (np.arange(rows) + 0.5 - rows / 2) * TEXEL_M * 1e3
    wide, high = CARD_M[0] * 500, CARD_M[1] * 500
    head = drawn(x, y, lines("MENU", 4.2, (0, high - 6.9)), 0.95)
    for side in (-1, 1):
        stem = [np.array([side * (9 + t), high - 6.9 + 0.9 * np.sin(t * 0.9)]) for t in np.linspace(0, 8, 17)]
        twigs = [(p, p + np.array([side * 0.9, (-1) ** k * 1.2])) for k, p in enumerate(stem[2:-1])]
        head = np.maximum(head, drawn(x, y, [*pairwise(stem), *twigs], 0.34))
    inset = np.minimum(wide - np.abs(x)[None, :], high - np.abs(y)[:, None])
    along = np.where(wide - np.abs(x)[None, :] < high - np.abs(y)[:, None], y[:, None], x[None, :])
    band = (inset > 3.6) & (y > high - 10.2)[:, None]
    lozenge = np.abs(np.mod(along, 1.6) - 0.8) + np.abs(inset - 2.0) < 0.72
    frame = (np.abs(inset - 1.0) < 0.22) | (np.abs(inset - 3.0) < 0.22)
    cover = np.where(band, 1 - head, lozenge | frame)
    for k, dish in enumerate(random.choice(DISHES, 5, replace=False)):
        cover = np.maximum(cover, drawn(x, y, lines(str(dish), 2.1, (0, 4.4 - 3.5 * k)), 0.46))
    paper = 0.78 * (1 + 0.025 * random.standard_normal((rows, columns)))
    worn = 1 - 0.10 * random.random((rows, columns))
    printed = paper + cover * worn * (ink - paper)
    bsdf = {"type": "diffuse", "reflectance": texture(np.clip(printed[::-1], 0.02, 0.9))}
    return mi.load_dict({"type": "twosided", "bsdf": bsdf})


def room(random: np.random.Generator) -> dict[str, Any]:
    """The room at dusk (W m^-2 sr^-1): dim walls, a pale ceiling, two tall windows, furniture; no sky."""
    rows, columns = 96, 192
    up = np.cos((np.arange(rows) + 0.5) / rows * np.pi)[:, None] + np.zeros(columns)
    picture = np.where(up > 0.55, 0.30, 0.13)
    picture[up < 0.0] = 0.05
    for at in random.integers(0, columns, 7):
        tall = int(random.integers(38, 50))
        picture[tall:56, at : at + int(random.integers(4, 16))] *= random.uniform(0.3, 0.8)
    for at in (20, 118):
        picture[24:44, at : at + 9] = 1.6
        picture[24:44, at + 4] = picture[33, at : at + 9] = 0.12
    return {"type": "envmap", "bitmap": mi.Bitmap(picture.astype(np.float32)[:, :, None].repeat(3, axis=2))}
