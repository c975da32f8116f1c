"""A clipping from a newspaper, creased and curled, over another page: set type, a screened photograph.

World frame: millimetres, x right, y up the page, z towards the lens; the clipping lies near z = 0.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from page import page_ink
from press import printed
from solids import Body, grid, placed, turning
from surfaces import matte, mesh, noise, panel, texture

CLIP_MM, PAGE_MM = (70.0, 58.0), (111.6, 79.2)
EDGE_MM = 19.0  # from the middle of the picture to the edge of the clipping
CELL_MM = 0.3
LAMP, WINDOW, ROOM = 38.0, 3.0, 0.12  # W m^-2 sr^-1


class Fold(NamedTuple):
    """A straight crease: where its normal points, how far from the middle it is, how much it bends."""

    way: float
    offset_mm: float
    slope: float


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (millimetres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1605, int(params["seed"])])
    inks = float(params["paper"]), float(params["ink"])
    side = 1 if params["cut"] == "right" else -1
    folds = _folds(float(params["crease_mm"]), random)
    cover = page_ink(CLIP_MM, params, random, detail=230)
    other_side = np.roll(cover, len(cover) // 3, axis=0)  # what shows through is too soft to be read
    clip_picture = printed(cover, other_side, inks, random)
    _wear(clip_picture, CLIP_MM, folds, random)
    edge = _edge(str(params["edge"]), random)
    if params["edge"] == "torn":
        _tear(clip_picture, edge, side, inks[0], random)
    below_params = params | {"motif": str(random.choice(["lighthouse", "steamer", "bridge"])), "layout": "picture"}
    below = page_ink(PAGE_MM, below_params, random, detail=120)
    below = below.reshape(len(below) // 2, 2, -1, 2).mean(axis=(1, 3))  # it is never in focus
    below_picture = printed(below, np.zeros_like(below), (inks[0] * 0.97, inks[1]), random)
    clip = _sheet(CLIP_MM, folds, float(params["crease_mm"]), random, edge=edge, side=side)
    lean = turning([0, 1, 0], params["tilt_deg"]) @ turning([0, 0, 1], params["turn_deg"])
    clip = placed(clip, [0, 0, params["height_mm"]], turn=lean)
    flat = _sheet(PAGE_MM, _folds(1.0, random), 1.2, random)
    turn = turning([0, 0, 1], random.uniform(-14, 14))
    flat = placed(flat, [side * 16, random.uniform(-8, 8), -params["below_mm"]], turn=turn)
    return {
        "clipping": mesh("clipping", clip, matte(texture(clip_picture))),
        "page": mesh("page", flat, matte(texture(below_picture))),
        **_lights(params),
    }


def _folds(crease_mm: float, random: np.random.Generator) -> list[Fold]:
    ways = np.cumsum([random.uniform(0, np.pi), *random.uniform(0.5, 1.5, 4)])
    strength = [1.0, 0.8, 0.55, 0.4, 0.3]
    return [
        Fold(way, random.uniform(-14, 14), 0.13 * crease_mm * s * random.choice([-1, 1]))
        for way, s in zip(ways, strength, strict=True)
    ]


def _edge(kind: str, random: np.random.Generator) -> np.ndarray:
    """How far the edge is from straight along the sheet (mm), one number a cell: scissors, or a tear."""
    count = round(CLIP_MM[1] / CELL_MM) + 1
    wave = noise((count, 2), (5, 1), random)[:, 0]
    if kind == "cut":
        return 0.35 * wave
    finer = noise((count, 2), (22, 1), random)[:, 0], noise((count, 2), (95, 1), random)[:, 0]
    return 1.5 * wave + 0.5 * finer[0] + 0.22 * finer[1]


def _sheet(
    size: tuple[float, float],
    folds: list[Fold],
    curl_mm: float,
    random: np.random.Generator,
    *,
    edge: np.ndarray | None = None,
    side: int = 1,
) -> Body:
    """A sheet that curls, with folds and the small dents of handled paper; its middle is at z = 0 on average.

    edge : ends the sheet at EDGE_MM on one side, with this outline.
    """  # fmt: skip
    rows, columns = (round(long / CELL_MM) for long in size[::-1])
    y = np.linspace(-size[1] / 2, size[1] / 2, rows + 1)[:, None]
    x = np.linspace(-size[0] / 2, size[0] / 2, columns + 1)[None, :] + 0 * y
    if edge is not None:
        stop = EDGE_MM + edge[:, None]
        x = side * (-size[0] / 2 + (stop + size[0] / 2) * np.linspace(0, 1, columns + 1)[None, :])
        x = x if side > 0 else x[:, ::-1]
    y = y + 0 * x
    turn, phase = random.uniform(0, 2 * np.pi, 2)
    z = 0.55 * curl_mm * np.sin(2 * np.pi / 70 * (np.cos(turn) * x + np.sin(turn) * y) + phase)
    for fold in folds:
        off = np.cos(fold.way) * x + np.sin(fold.way) * y - fold.offset_mm
        sharp = np.sqrt(off * off + 0.12)  # the ridge is rounded over a third of a millimetre
        z += fold.slope * (sharp - 0.022 * off * off)
    lattice = (rows + 1, columns + 1)
    for cells, depth in ((7, 0.16), (19, 0.07), (52, 0.022), (120, 0.008)):
        z += depth * curl_mm * np.abs(noise(lattice, (cells * rows / columns, cells), random))
    if edge is not None:  # it lifts towards its free edge
        z += 0.9 * curl_mm * np.clip((side * x - EDGE_MM + 16) / 16, 0, 1) ** 2
    z -= np.median(z)
    uv = np.stack([x / size[0] + 0.5, y / size[1] + 0.5], axis=2)
    return grid(np.stack([x, y, z], axis=2), uv=uv)


def _places(size: tuple[float, float], picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates x (1, columns) and y (rows, 1) of texels on a sheet, mm."""
    rows, columns = picture.shape
    y = (0.5 - (np.arange(rows) + 0.5) / rows) * size[1]
    x = ((np.arange(columns) + 0.5) / columns - 0.5) * size[0]
    return x[None, :], y[:, None]


def _wear(picture: np.ndarray, size: tuple[float, float], folds: list[Fold], random: np.random.Generator) -> None:
    """Along folds the ink has cracked and the fibres stand up; in place."""
    x, y = _places(size, picture)
    ragged = noise(picture.shape, (picture.shape[0] / 5, picture.shape[1] / 5), random)
    for fold in folds[:3]:
        off = np.abs(np.cos(fold.way) * x + np.sin(fold.way) * y - fold.offset_mm)
        worn = np.clip(1 - off / (0.16 + 0.22 * np.clip(ragged, -0.4, 1)), 0, 1) * min(abs(fold.slope) / 0.15, 1)
        picture += 0.5 * worn * np.clip(0.6 + ragged, 0, 1) * (0.5 - picture)
        picture *= 1 - 0.05 * np.exp(-((off / 1.6) ** 2))  # dust that has settled beside it


def _tear(picture: np.ndarray, edge: np.ndarray, side: int, paper: float, random: np.random.Generator) -> None:
    """Beside a tear the printed face is gone, and the bare fibres below are lighter; in place."""
    x, y = _places(CLIP_MM, picture)
    stop = np.interp(y[:, 0], np.linspace(-CLIP_MM[1] / 2, CLIP_MM[1] / 2, len(edge)), edge)[:, None] + EDGE_MM
    ragged = noise(picture.shape, (picture.shape[0] / 6, picture.shape[1] / 6), random)
    width = 0.55 + 0.55 * noise(picture.shape, (16, 12), random) + 0.30 * ragged
    bare = np.clip((width - (stop - side * x)) / 0.12, 0, 1)
    picture += bare * (paper * (1.10 + 0.10 * ragged) - picture)


def _lights(params: dict[str, Any]) -> dict[str, Any]:
    a = np.radians(float(params["lamp_azimuth_deg"]))
    lamp = (480 * np.sin(a), 220 + 80 * np.cos(a), 250)
    return {
        "lamp": panel(lamp, (0, 0, 0), (110, 110), LAMP),
        "window": panel((-500 * np.sign(a), 150, 420), (0, 0, 0), (420, 500), WINDOW),
        "room": {"type": "constant", "radiance": ROOM},
    }
