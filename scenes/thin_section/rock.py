"""Grains of a rock as pictures over a section: which mineral where, how it lies, how it is twinned."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from optics import transmittance
from scipy.spatial import cKDTree
from surfaces import cloudy, noise

SIZE_UM, TEXEL_UM = (2200.0, 1560.0), 1.4  # wider than the field of 1600 µm × 1000 µm; a pixel sees 4 µm


class Mineral(NamedTuple):
    """Birefringence; what the crystal lets through; twins; cleavage, 0..1; the share that it throws back."""

    birefringence: float
    clear: float
    twin: str
    cleavage: float
    reflects: float


MINERALS = {
    "plagioclase": Mineral(0.009, 0.97, "lamellae", 0.15, 0.05),
    "quartz": Mineral(0.009, 0.98, "undulose", 0.0, 0.05),
    "microcline": Mineral(0.007, 0.96, "tartan", 0.1, 0.05),
    "augite": Mineral(0.025, 0.85, "none", 0.6, 0.06),
    "olivine": Mineral(0.036, 0.93, "none", 0.35, 0.06),
    "biotite": Mineral(0.042, 0.45, "none", 1.0, 0.05),
    "calcite": Mineral(0.172, 0.95, "thin", 0.7, 0.07),
    "magnetite": Mineral(0.0, 0.0, "none", 0.0, 0.20),
}
# Shares of what fills the space, then laths: mineral, how many, length and width in mean grains.
ROCKS = {
    "gabbro": (
        {"augite": 0.62, "olivine": 0.28, "magnetite": 0.10},
        (("plagioclase", 75, 2.6, 0.62), ("olivine", 9, 1.1, 0.9), ("magnetite", 12, 0.35, 0.3)),
    ),
    "granite": (
        {"quartz": 0.42, "microcline": 0.30, "plagioclase": 0.22, "biotite": 0.06},
        (("biotite", 16, 1.3, 0.5), ("plagioclase", 10, 1.6, 0.8), ("magnetite", 8, 0.2, 0.2)),
    ),
    "marble": ({"calcite": 0.93, "quartz": 0.05, "magnetite": 0.02}, (("magnetite", 5, 0.25, 0.2),)),
}


def layers(params: dict, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Transmittance of both sheets, and the share that the upper one reflects; row 0 at the bottom."""
    fills, laths = ROCKS[params["rock"]]
    x, y = (np.arange(round(s / TEXEL_UM)) * TEXEL_UM - s / 2 for s in SIZE_UM)
    shape = y.size, x.size
    x, y = (plane.astype(np.float32) for plane in np.meshgrid(x, y))
    size = params["grain_um"]
    grain, rim = _cells(x, y, size, random)
    names = list(MINERALS)
    count = int(grain.max()) + 1
    kinds = random.choice([names.index(n) for n in fills], count, p=list(fills.values()))
    kinds = list(kinds)
    for name, number, long, wide in laths:
        for _ in range(number):
            inside, edge = _lath(x, y, size * np.array([long, wide]), random)
            grain[inside] = len(kinds)
            rim[inside] = edge
            kinds.append(names.index(name))
    kind = np.array(kinds)
    mineral = kind[grain]
    turn, retardation = _crystals(x, y, grain, kind, params, random)
    light = transmittance(retardation, turn + np.radians(params["stage_deg"]))
    light *= np.array([MINERALS[n].clear for n in names])[mineral]
    light *= 1 + 0.10 * noise(shape, (shape[0] / 1.7, shape[1] / 1.7), random)  # the ground face
    cracks = _cracks(x, y, grain, kind, random)
    bounds = np.exp(-((rim / 2.2) ** 2))
    upper = light * (1 - 0.75 * bounds) * (1 - 0.7 * cracks)
    dust = cloudy(shape, 160, 3, random) > 1.15
    lower = (1 - 0.35 * np.exp(-((np.roll(rim, (5, -4), (0, 1)) / 4.0) ** 2))) * np.where(dust, 0.5, 0.99)
    back = np.array([MINERALS[n].reflects for n in names])[mineral] * (1 + 0.8 * cracks + 0.5 * bounds)
    back *= 1 + 0.15 * noise(shape, (shape[0] / 2, shape[1] / 2), random)
    return upper.clip(0, 1), lower.clip(0, 1), back.clip(0, 0.5)


def _cells(
    x: np.ndarray, y: np.ndarray, size: float, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """The grain of every texel, and about how far it is to the next one (µm); boundaries are sutured."""
    count = round(SIZE_UM[0] * SIZE_UM[1] / size**2)
    middles = random.uniform(-0.52, 0.52, (count, 2)) * SIZE_UM
    bend = [
        0.10 * size * noise(x.shape, (9, 13), random) + 0.03 * size * noise(x.shape, (50, 70), random)
        for _ in (0, 1)
    ]
    places = np.stack([x + bend[0], y + bend[1]], axis=2).reshape(-1, 2)
    far, which = cKDTree(middles).query(places, k=2, workers=1)
    return which[:, 0].reshape(x.shape), ((far[:, 1] - far[:, 0]) / 2).reshape(x.shape)


def _lath(
    x: np.ndarray, y: np.ndarray, size: np.ndarray, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Texels of a crystal with straight faces and cut corners, and how far they lie inside (µm)."""
    at, angle = random.uniform(-0.5, 0.5, 2) * SIZE_UM, random.uniform(0, np.pi)
    half = size / 2 * random.uniform(0.6, 1.3, 2)
    u = (x - at[0]) * np.cos(angle) + (y - at[1]) * np.sin(angle)
    v = (y - at[1]) * np.cos(angle) - (x - at[0]) * np.sin(angle)
    u = u + 0.03 * size[0] * noise(x.shape, (37, 53), random)
    ends = half[0] + half[1] * 0.6 - np.abs(u) - 0.6 * np.abs(v)
    inside = np.minimum(np.minimum(half[0] - np.abs(u), half[1] - np.abs(v)), 0.85 * ends)
    chosen = inside > 0
    return chosen, inside[chosen]


def _crystals(
    x: np.ndarray,
    y: np.ndarray,
    grain: np.ndarray,
    kind: np.ndarray,
    params: dict,
    random: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Direction of vibration (rad) and retardation (nm) of every texel, with twins, zones and strain."""
    names, n = list(MINERALS), len(kind)
    turn = random.uniform(0, np.pi, n).astype(np.float32)
    strong = np.array([MINERALS[name].birefringence for name in names])[kind]
    # A random axis stands at an angle with a uniform cosine to the light; birefringence goes as sin².
    seen = (1 - random.uniform(-0.95, 0.95, n) ** 2) * strong * params["thickness_um"] * 1e3
    along = random.uniform(0, np.pi, n).astype(np.float32)
    period = params["grain_um"] * random.uniform(0.05, 0.13, n).astype(np.float32)
    phase = random.uniform(0, 1, n).astype(np.float32)
    twin = np.array(
        [("none", "lamellae", "undulose", "tartan", "thin").index(MINERALS[m].twin) for m in names]
    )
    style = twin[kind][grain]
    across = x * np.cos(along)[grain] + y * np.sin(along)[grain]
    beside = y * np.cos(along)[grain] - x * np.sin(along)[grain]
    wide, far = across / period[grain] + 6 * phase[grain], beside / period[grain]
    lamellae = (
        np.sin(6.0 * wide) + 0.8 * np.sin(13.7 * wide) + 0.9 * np.sin(2.6 * wide + 0.5 * np.sin(0.4 * far))
    )
    lamellae += 0.5 * noise(x.shape, (14, 20), random)  # some of them end in the crystal
    angle = turn[grain]
    angle = angle + np.where(style == 1, 0.42 / (1 + np.exp(-9 * (lamellae - 0.3))), 0)
    angle += np.where(style == 2, 0.28 * cloudy(x.shape, 9, 3, random), 0)
    bend, fine = 2.0 * noise(x.shape, (40, 56), random), noise(x.shape, (130, 180), random)
    spindle = np.sin(9.0 * wide + bend + 0.7 * np.sin(1.9 * far)) + 0.5 * np.sin(16.3 * wide + 2 * bend)
    weft = np.sin(8.0 * far - 1.3 * bend + 0.7 * np.sin(2.3 * wide)) + 0.5 * np.sin(14.1 * far - bend)
    angle += np.where(style == 3, 0.24 * np.tanh(1.1 * (spindle + weft + 0.8 * fine)), 0)
    gaps = np.mod(1.1 * wide + 0.32 * np.sin(2.3 * wide) + 0.2 * np.sin(5.1 * wide), 1)
    lines = (np.abs(gaps - 0.5) < 0.05) & (noise(x.shape, (12, 17), random) > -0.35)
    angle += np.where((style == 4) & lines, np.float32(0.75), 0)
    zones = np.where(style == 1, 0.06 * cloudy(x.shape, 12, 2, random), 0)
    wedge = 1 + 0.03 * noise(x.shape, (4, 6), random)  # the section is not quite even
    return angle + zones, (seen[grain] * wedge).astype(np.float32)


def _cracks(
    x: np.ndarray, y: np.ndarray, grain: np.ndarray, kind: np.ndarray, random: np.random.Generator
) -> np.ndarray:
    """Cleavages, straight in each grain, and wandering cracks, 0..1."""
    n = len(kind)
    names = list(MINERALS)
    cleaves = np.array([MINERALS[name].cleavage for name in names])[kind].astype(np.float32)
    along, gap = random.uniform(0, np.pi, n).astype(np.float32), random.uniform(14, 40, n).astype(np.float32)
    made = np.zeros(x.shape, dtype=np.float32)
    for second in (0.0, 1.35):  # two sets, the other one weaker
        place = (x * np.cos(along + second)[grain] + y * np.sin(along + second)[grain]) / gap[grain]
        line = np.exp(-((np.abs(np.mod(place, 1) - 0.5) * gap[grain] / 1.3) ** 2))
        broken = np.clip(0.3 + 1.4 * noise(x.shape, (45, 64), random), 0, 1)
        made = np.maximum(made, line * broken * cleaves[grain] * (1.0 if second == 0 else 0.6))
    wander = np.abs(cloudy(x.shape, 11, 4, random)) * 60.0
    return np.maximum(made, 0.8 * np.exp(-((wander / 1.4) ** 2)) * (noise(x.shape, (8, 11), random) > 0))
