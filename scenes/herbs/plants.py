"""Herbs as leaves and stalks: each grows from the soil at the origin; metres, y up."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from solids import Body, grid, joined, placed, rounded, tube, turning
from surfaces import cloudy, noise

Plant = tuple[Body, Body]  # leaves; stalks, which carry tones
ATLAS, TEXELS = 3, 300  # leaves across and down the picture, texels of one
SOIL_Y = -0.012


def leaf_picture(green: float, random: np.random.Generator) -> np.ndarray:
    """Nine leaves side by side: midrib, veins that branch off it, blotches; the tip of each on top."""
    rows = []
    v, u = np.meshgrid(np.linspace(0, 1, TEXELS), np.linspace(-1, 1, TEXELS), indexing="ij")
    for _ in range(ATLAS):
        row = []
        for _ in range(ATLAS):
            phase = 9.0 * (v - 0.55 * np.abs(u)) + random.uniform(0, 1) + 0.12 * cloudy(v.shape, 4, 3, random)
            away = np.abs(phase - np.round(phase))
            veins = np.clip(1 - away / 0.07, 0, 1) * np.clip(1.15 - np.abs(u), 0, 1)
            rib = np.clip(1 - np.abs(u) / 0.045, 0, 1)
            net = np.clip(1 - np.abs(noise(v.shape, (26, 22), random)) / 0.12, 0, 1)
            tone = random.uniform(0.8, 1.2) * (1 + 0.14 * cloudy(v.shape, 5, 5, random)) * (1 - 0.16 * net)
            tone = tone * (1 - 0.25 * np.exp(-(((away - 0.12) / 0.05) ** 2)))
            tone = tone + 0.75 * np.maximum(rib, 0.7 * veins)
            if random.uniform() < 0.3:  # nibbled or scorched
                tone *= 1 + 0.9 * np.clip(2.5 * cloudy(v.shape, 3, 4, random) - 1.1, 0, 1)
            row.append(tone[::-1])
        rows.append(np.concatenate(row, axis=1))
    return np.clip(green * np.concatenate(rows), 0.02, 0.6)


def leaf(
    length: float,
    width: float,
    random: np.random.Generator,
    *,
    arch: float,
    fold: float,
    cells: tuple[int, int] = (10, 4),
) -> Body:
    """A leaf from the origin along +z, upper side up, bent by ``arch``, folded by ``fold`` (radians)."""
    s, t = np.meshgrid(np.linspace(0, 1, cells[0] + 1), np.linspace(-1, 1, cells[1] + 1), indexing="ij")
    bend = arch * s
    shape = np.maximum(np.sin(np.pi * s**0.75), 0.03)
    half = 0.5 * width * shape
    bulge = 0.10 * width * np.sin(2 * np.pi * (2.5 * s + random.uniform())) * np.abs(t) * shape
    high = half * np.abs(t) * np.sin(fold) + bulge
    y = -0.5 * length * bend * np.sinc(bend / (2 * np.pi)) ** 2 * s + high * np.cos(bend)
    z = length * np.sinc(bend / np.pi) * s + high * np.sin(bend)
    points = np.stack([half * t * np.cos(fold), y, z], axis=2)
    column, row = random.integers(0, ATLAS, 2)
    uv = np.stack([(column + 0.5 + 0.46 * t) / ATLAS, (row + 0.02 + 0.96 * s) / ATLAS], axis=2)
    return grid(points, uv=uv)


def _set(body: Body, at: np.ndarray, azimuth: float, rise: float, roll: float = 0.0) -> Body:
    """The leaf at a node: turned about y by the azimuth, its tip raised by ``rise``; all in degrees."""
    turn = turning([0, 1, 0], azimuth) @ turning([1, 0, 0], -rise) @ turning([0, 0, 1], roll)
    return placed(body, at, turn=turn)


def _stalk(random: np.random.Generator, *, reach: float, high: float, root: float) -> np.ndarray:
    """A stalk's path (n, 3) from the soil, leaning outwards."""
    a = random.uniform(0, 2 * np.pi)
    out = np.array([np.cos(a), 0, np.sin(a)])
    foot = root * np.sqrt(random.uniform()) * out + [0, SOIL_Y, 0]
    tip = foot + reach * random.uniform(0.3, 1.0) * out + [0, high, 0]
    mid = foot + (tip - foot) * [0.3, 0.55, 0.3] + 0.004 * random.standard_normal(3)
    return rounded([foot, mid, tip])


def basil(random: np.random.Generator) -> Plant:
    """Pairs of broad leaves, each pair across the one below."""
    green, wood = [], []
    for _ in range(9):
        path = _stalk(random, reach=0.034, high=random.uniform(0.045, 0.080), root=0.022)
        wood.append(tube(path, np.linspace(1.6e-3, 1.0e-3, len(path)), around=8, tone=0.16))
        nodes, first = 5, random.uniform(0, 180)
        for k in range(nodes):
            at = path[round((len(path) - 1) * (0.30 + 0.70 * k / (nodes - 1)))]
            long = (0.034 - 0.006 * k) * random.uniform(0.8, 1.15)
            for side in (0, 180):
                arch, fold = random.uniform(0.4, 1.3), random.uniform(0.1, 0.5)
                made = leaf(long, 0.62 * long, random, arch=arch, fold=fold)
                rise, roll = 12 + 11 * k + random.normal(0, 9), random.normal(0, 10)
                azimuth = first + side + 90 * k + random.normal(0, 12)
                green.append(_set(made, at, azimuth, rise, roll))
    return joined(green), joined(wood)


def rosemary(random: np.random.Generator) -> Plant:
    """Woody stalks with whorls of needles."""
    green, wood = [], []
    for _ in range(11):
        path = _stalk(random, reach=0.045, high=random.uniform(0.055, 0.095), root=0.02)
        wood.append(tube(path, np.linspace(1.5e-3, 0.7e-3, len(path)), around=8, tone=0.12))
        for share in np.linspace(0.15, 1.0, 26):
            at = path[round((len(path) - 1) * share)]
            for _ in range(3):
                long = random.uniform(0.014, 0.022) * (1 - 0.4 * max(share - 0.75, 0) / 0.25)
                made = leaf(long, 0.0030, random, arch=random.uniform(-0.2, 0.5), fold=-0.5, cells=(5, 2))
                green.append(_set(made, at, random.uniform(0, 360), 35 + 30 * share + random.normal(0, 12)))
    return joined(green), joined(wood)


def chives(random: np.random.Generator) -> Plant:
    """Hollow leaves like grass, some with a ball of flowers."""
    green, wood = [], []
    for k in range(95):
        path = _stalk(random, reach=0.05, high=random.uniform(0.05, 0.10), root=0.03)
        thick = random.uniform(0.8e-3, 1.4e-3)
        green.append(tube(path, thick * np.linspace(1, 0.35, len(path)), around=7))
        if k % 19 == 0:
            for _ in range(70):
                d = random.standard_normal(3)
                d /= np.linalg.norm(d)
                d[1] = abs(d[1]) * 0.9 - 0.15
                petal = np.array([path[-1] + 0.002 * d, path[-1] + 0.0075 * d])
                wood.append(tube(petal, 0.9e-3, around=5, tone=random.uniform(0.25, 0.5)))
    return joined(green), joined(wood)


def thyme(random: np.random.Generator) -> Plant:
    """Wiry stalks that hang over the rim, with small leaves in pairs."""
    green, wood = [], []
    for _ in range(34):
        path = _stalk(random, reach=0.055, high=random.uniform(0.020, 0.060), root=0.028)
        wood.append(tube(path, np.linspace(0.7e-3, 0.4e-3, len(path)), around=6, tone=0.12))
        for k, share in enumerate(np.linspace(0.15, 1.0, 13)):
            at = path[round((len(path) - 1) * share)]
            for side in (0, 180):
                long = random.uniform(0.0055, 0.0085)
                made = leaf(long, 0.55 * long, random, arch=random.uniform(0, 0.8), fold=0.15, cells=(5, 2))
                green.append(_set(made, at, 90 * k + side + random.normal(0, 20), 25 + random.normal(0, 18)))
    return joined(green), joined(wood)


KINDS: dict[str, Callable[[np.random.Generator], Plant]] = {
    "basil": basil,
    "rosemary": rosemary,
    "chives": chives,
    "thyme": thyme,
}
