"""Reflectances, roughness and relief of the sign's board and of brick, float32, row 0 on top."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from surfaces import cloudy, noise, texture
from typeface import Typeface, ink

TEXEL_M = 0.001  # of the board; a pixel sees 2.5 mm
COURSE, BRICK, TILE = 0.075, 0.24, 1.2  # of the brickwork; a repeat of its picture
LINES = {
    "HOTEL": "ROOMS BY THE NIGHT  ·  SINCE 1926",
    "CAFE": "HOT SUPPERS  ·  UNTIL TWO",
    "BAR": "WINES  ·  SPIRITS  ·  COLD BEER",
    "JAZZ": "NIGHTLY FROM NINE  ·  DOWNSTAIRS",
    "FILM": "CONTINUOUS FROM NOON",
    "OPEN": "WALK RIGHT IN",
}


def board(
    size: tuple[float, float], tone: float, text: str, paths: list[np.ndarray], random: np.random.Generator
) -> np.ndarray:
    """An enamelled board: letters painted below the tubes, a line of type, a double line round it; weathered.

    paths : centre lines of the word's tubes, metres from the middle.
    """
    shape = round(size[1] / TEXEL_M), round(size[0] / TEXEL_M)
    x = ((np.arange(shape[1]) + 0.5) / shape[1] - 0.5) * size[0]
    y = (0.5 - (np.arange(shape[0]) + 0.5) / shape[0]) * size[1]
    grey = tone * (1 + 0.10 * cloudy(shape, 9, 4, random))
    away = np.full(shape, 1.0)
    for path in paths:
        for px, py in path[::2]:
            near = np.abs(y - py) < 0.03
            off = np.hypot(x[None, :] - px, y[near, None] - py)
            away[near] = np.minimum(away[near], off)
    worn = 0.5 + 0.5 * cloudy(shape, 12, 5, random)
    paint = 0.48 * (0.75 + 0.35 * worn)
    for edge, value in ((0.0205, 0.35 * tone), (0.0165, paint)):
        cover = np.clip((edge - away) / TEXEL_M + 0.5, 0, 1)
        grey = grey + cover * (value - grey)
    face = Typeface(Path(__file__).parent / "condensed.npz")
    em = 0.0185 / face.cap_height
    em *= min(0.38 / face.width(LINES[text], size=em, tracking=0.06), 1.0)
    line = face.line(LINES[text], (size[0] / 2, size[1] / 2 + 0.085), size=em, align="centre", tracking=0.06)
    printed = ink(line, shape, scale=1 / TEXEL_M)
    grey = grey + printed * (paint - grey)
    edge = np.minimum(np.abs(x[None, :]) * -1 + size[0] / 2, size[1] / 2 - np.abs(y[:, None]))
    for low, high in ((0.006, 0.0105), (0.0125, 0.0140)):
        grey = np.where((edge > low) & (edge < high), paint, grey)
    runs = noise(shape, (2, 90), random) + 0.6 * noise(shape, (3, 31), random)
    grey = grey * (1 - 0.28 * np.clip(runs, 0, 1)) * (1 - 0.5 * np.exp(-edge / 0.007))
    lumps = noise(shape, (60, 110), random) + 0.6 * noise(shape, (20, 40), random)
    near_rim = 0.55 * np.exp(-edge / 0.02)
    grey = np.where(lumps + near_rim > 1.12, 0.035, grey)  # chips down to the steel
    halo = np.clip((lumps + near_rim - 0.86) / 0.26, 0, 1)
    grey = grey * (1 - 0.35 * halo)  # rust has run into the enamel about them
    return np.clip(grey, 0.015, 0.7).astype(np.float32)


def brickwork(tone: float, random: np.random.Generator) -> dict[str, Any]:
    """Stretchers in old mortar after rain: relief, and damp where it is darker and smoother; one tile."""
    n = 960
    y, x = np.mgrid[0:n, 0:n] / n * TILE
    wave = 0.0016 * noise((n, n), (40, 40), random)
    row = np.floor((y + wave) / COURSE).astype(int) % 16
    along = np.mod((x + wave) / BRICK + 0.5 * (row % 2) + 0.03 * random.normal(size=16)[row], 5)
    column = np.floor(along).astype(int)
    part, up = np.mod(along, 1) * BRICK, np.mod(y + wave, COURSE)
    fine = noise((n, n), (420, 420), random)
    off = np.minimum(np.minimum(part, BRICK - part), np.minimum(up, COURSE - up)) + 0.0014 * fine
    joint = np.clip((0.0058 - off) / 0.0035, 0, 1)
    each = random.normal(1, 0.24, (16, 5))[row, column]
    each = np.where(random.random((16, 5))[row, column] < 0.08, 0.45, np.clip(each, 0.5, 1.5))
    grit = noise((n, n), (480, 480), random) + cloudy((n, n), 30, 4, random)
    grey = tone * each * (1 + 0.15 * grit)
    grey = grey + joint * (1.9 * tone * (1 + 0.12 * grit) - grey)
    damp = np.clip(0.5 + 1.1 * noise((n, n), (3, 26), random) + 0.8 * cloudy((n, n), 4, 4, random), 0, 1)
    grey = grey * (1 - 0.45 * damp)
    faces = 0.0008 * random.normal(size=(16, 5))[row, column] + 0.0006 * cloudy((n, n), 60, 4, random)
    height = (1 - joint) * (0.0045 + faces) + 0.0004 * grit * (1 - 0.5 * damp)
    rough = 0.62 - 0.36 * damp * (1 - 0.6 * joint)
    coat = {
        "type": "principled",
        "base_color": tiled(np.clip(grey, 0.012, 0.6)),
        "roughness": tiled(rough),
        "specular": 0.5,
    }
    return {"type": "twosided", "bsdf": {"type": "bumpmap", "relief": tiled(height), "bsdf": coat}}


def tiled(picture: np.ndarray) -> dict[str, Any]:
    """A picture that is repeated in every unit of u and v."""
    return texture(picture.astype(np.float32), repeat=(1, 1))
