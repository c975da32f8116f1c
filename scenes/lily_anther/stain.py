"""Pictures of the section: absorbance of its two layers, from cells and grains; float32 (row, col)."""

from __future__ import annotations

import numpy as np
from anther import ENDOTHECIUM, EPIDERMIS, MIDDLE, PARENCHYMA, PHLOEM, TAPETUM, XYLEM, Anther
from raster import View, local, nearest, noise, smooth

# By kind: absorbance of wall, of plasm; share of the cells that the cut finds a nucleus in; its radius (µm).
LOOK = {
    EPIDERMIS: (0.62, 0.12, 0.55, 4.2),
    ENDOTHECIUM: (0.55, 0.10, 0.5, 4.6),
    MIDDLE: (0.45, 0.24, 0.4, 2.8),
    TAPETUM: (0.66, 0.32, 0.85, 5.0),
    PARENCHYMA: (0.42, 0.04, 0.3, 4.4),
    PHLOEM: (0.42, 0.10, 0.35, 2.0),
    XYLEM: (0.80, 0.02, 0.0, 1.0),
}
WALL_UM = {XYLEM: 1.5, EPIDERMIS: 1.15}  # half thickness where it is not 0.9


def layers(
    anther: Anther, view: View, grain_um: float, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Absorbance of the upper and the lower layer."""
    x, y = view.grid()
    tissue = _tissue(anther, view, x, y, random)
    upper, lower = tissue, 0.22 * _shifted(tissue, 2, -1)
    for layer, share in ((upper, 0.85), (lower, 0.35)):
        for px, py, cut, lift in anther.grains(grain_um, random):
            if random.random() < share:
                _grain(layer, view, (px, py), cut, abs(lift), random)
    return upper + 0.015, lower


def _shifted(image: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """Walls stand not quite upright in the section: below they lie a little beside, and softer."""
    near = np.roll(image, (rows, columns), (0, 1))
    return (near + np.roll(near, 1, 0) + np.roll(near, 1, 1) + np.roll(near, (1, 1), (0, 1))) / 4


def _tissue(
    anther: Anther, view: View, x: np.ndarray, y: np.ndarray, random: np.random.Generator
) -> np.ndarray:
    table = anther.cells.table
    first, second, wide_1, wide_2, owner = nearest(table, view)
    edge = (second - first) / (1 / wide_1 + 1 / wide_2)  # µm to the wall in the middle between two cells
    kind = np.where(owner >= 0, table[owner, 6].astype(np.int8), -1)
    skin, sac = smooth(anther.outline, x, y), smooth(anther.sacs, x, y)
    swell = np.minimum(edge / 6, 1)
    outside = np.where(kind == EPIDERMIS, skin > 4.0 * swell - 1.0, skin > 0)
    hollow = np.where(kind == TAPETUM, sac < -5.0 * swell + 1.5, sac < 0)
    void = outside | hollow | (owner < 0)
    rim = np.minimum(np.abs(skin - (4.0 * swell - 1.0)), 9)
    grain = noise(x.shape, 1.6, random)
    look = np.array([LOOK[k] for k in range(len(LOOK))], dtype=np.float32)
    each = random.uniform(0.7, 1.3, len(table)).astype(np.float32)
    thick = np.array([WALL_UM.get(k, 0.9) for k in range(len(LOOK))], dtype=np.float32)
    wall = look[kind, 0] * np.exp(-((edge / thick[kind]) ** 2))
    lining = 0.16 * np.exp(-np.maximum(edge - 1, 0) / 2.2)  # plasm along the wall
    plasm = look[kind, 1] * each[owner] * (1 + 0.55 * grain) + lining * (1 + 0.8 * grain)
    plasm[kind == XYLEM] = 0.0
    image = np.maximum(wall, np.where(edge > 0.5, plasm, 0))
    _nuclei(image, table, view, random)
    image[void] = 0
    cuticle = (kind == EPIDERMIS) & (skin > -6)
    image = np.where(cuticle, np.maximum(image, 0.75 * np.exp(-((rim / 1.3) ** 2))), image)
    _orbicules(image, sac, random)
    return image.astype(np.float32)


def _nuclei(image: np.ndarray, table: np.ndarray, view: View, random: np.random.Generator) -> None:
    for x, y, tx, ty, a, b, kind in table:
        _, _, share, radius = LOOK[int(kind)]
        sides = (-1, 1) if kind == TAPETUM and random.random() < 0.5 else (random.uniform(-0.5, 0.5),)
        for side in sides:
            size = radius * random.uniform(0.75, 1.1)
            along, across = 0.42 * side * a, random.uniform(-0.25, 0.25) * b
            at = (x + along * tx - across * ty, y + along * ty + across * tx)
            if random.random() > share:
                continue
            here = local(image.shape, view, at, 1.5 * size)
            if here is None:
                continue
            window, r, angle = here
            rim = size * (1 + 0.12 * np.sin(2 * angle + random.uniform(0, 6)))
            disc = np.clip((rim - r) / 0.8 + 0.5, 0, 1)
            chromatin = 0.5 + 0.12 * np.sin(1.9 * r + 3 * angle + random.uniform(0, 6))
            nucleolus = (
                0.35 * np.exp(-(((r - 0.35 * size) / (0.3 * size)) ** 2) * 4) * (np.cos(angle - 6 * size) > 0)
            )
            part = image[window]
            np.maximum(part, disc * (chromatin + nucleolus + 0.25 * np.exp(-((r - rim) ** 2))), out=part)


def _grain(
    image: np.ndarray,
    view: View,
    at: tuple[float, float],
    cut: float,
    lift: float,
    random: np.random.Generator,
) -> None:
    """A pollen grain as the cut finds it: near its middle a ring, towards its top the net of its coat."""
    here = local(image.shape, view, at, 1.25 * cut + 4)
    if here is None:
        return
    window, r, angle = here
    slant = np.clip(lift, 0, 0.97)
    coat = 2.8 / np.sqrt(1 - slant**2)  # thickness of the exine as it is cut, µm
    oval = (
        1 + 0.05 * np.sin(2 * angle + random.uniform(0, 6)) + 0.018 * np.sin(3 * angle + random.uniform(0, 6))
    )
    rim = cut * oval
    inward = rim - r
    rods = 0.5 + 0.5 * np.sin(angle * max(round(2 * np.pi * cut / 3.4), 6) + random.uniform(0, 6))
    exine = 0.8 * np.clip(inward / 0.7 + 0.5, 0, 1) * np.clip((coat - inward) / 0.8, 0, 1)
    exine *= 0.55 + 0.45 * np.where(inward < 0.6 * coat, rods, 1.0)
    body = np.clip((inward - coat) / 0.8, 0, 1)
    mottle = noise(r.shape, 2.1, random) + 0.8 * noise(r.shape, 6.0, random)
    plasm = 0.24 * (1 + 0.5 * mottle)
    bubbles = noise(r.shape, 4.2, random) > 0.55  # small vacuoles
    plasm = np.where(bubbles, 0.35 * plasm, plasm)
    if lift < 0.55:
        off, towards = random.uniform(0.0, 0.35) * cut, random.uniform(0, 2 * np.pi)
        nr = np.sqrt(np.maximum(r**2 + off**2 - 2 * r * off * np.cos(angle - towards), 0))
        size = random.uniform(0.25, 0.33) * cut
        plasm = np.where(nr < size, 0.42 + 0.1 * mottle, plasm) + 0.2 * np.exp(-((nr - size) ** 2))
        plasm = np.where(nr < 0.3 * size, 0.85, plasm)
    if lift > 0.8:
        net = np.abs(noise(r.shape, 4.0, random)) < 0.16
        plasm = np.where(net, 0.6, 0.2)
    part = image[window]
    np.copyto(part, np.maximum(exine, body * plasm).astype(np.float32), where=inward > -0.6)


def _orbicules(image: np.ndarray, sac: np.ndarray, random: np.random.Generator) -> None:
    """Fine droplets on the inner face of the tapetum, and a thin precipitate in the sacs."""
    fine, coarse = noise(image.shape, 1.5, random), noise(image.shape, 19.0, random)
    coarse += 0.5 * noise(image.shape, 7.0, random)
    near = np.exp(-(((sac + 2.5) / 5.0) ** 2))
    inside = (image == 0) & (sac < 3)
    image += inside * (0.025 + 0.01 * coarse + near * 0.5 * (fine > 0.45))
