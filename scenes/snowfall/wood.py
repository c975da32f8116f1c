"""Firs under snow, drifts and caps of snow, and the flakes; metres, y up."""

from __future__ import annotations

import numpy as np
from solids import Body, grid, joined, placed, turning

SNOW, NEEDLES, BARK = 0.80, 0.055, 0.10  # reflectances
AROUND = 44


def fir(high: float, random: np.random.Generator) -> Body:
    """A young fir of whorls that droop, snow on what faces up; its foot at the origin."""
    whorls = max(round(high / 0.17), 7)
    angle = np.linspace(0, 2 * np.pi, AROUND + 1)
    made = []
    for k in range(whorls):
        share = (k / whorls) ** 1.4
        top = high * (1 - share * 0.86)
        reach = 0.30 * high * (0.10 + 0.90 * share) * random.uniform(0.85, 1.15)
        spokes = random.integers(7, 11)
        phase = random.uniform(0, 2 * np.pi)
        frond = 0.62 + 0.38 * np.cos(spokes * angle + phase) + 0.16 * random.standard_normal(AROUND + 1)
        frond[-1] = frond[0]
        rings, tones = [], []
        for s in (0.0, 0.4, 0.75, 1.0):
            radius = reach * s * (1 - 0.45 * s * (1 - frond))
            drop = reach * (0.75 * s**1.4 + 0.12 * s * (1 - frond))
            rings.append(np.stack([radius * np.cos(angle), top - drop, -radius * np.sin(angle)], axis=1))
            loaded = np.clip(
                0.95 - 0.75 * s + 0.4 * (frond - 0.6) + 0.4 * random.standard_normal(AROUND + 1), 0, 1
            )
            loaded[-1] = loaded[0]
            tones.append(np.where(loaded > 0.45, SNOW, NEEDLES))
        made.append(grid(np.stack(rings)[::-1], tone=np.stack(tones)[::-1]))
        below = np.stack(
            [rings[-1], 0.4 * rings[-1] * [1, 0, 1] + (top - 0.45 * reach) * np.array([0, 1, 0])]
        )
        made.append(grid(below[::-1], tone=NEEDLES * 0.6))
    return joined(made)


def hill(random: np.random.Generator) -> Body:
    """The snowy ground: it rises from the sign to the wood, with drifts."""
    z, x = np.meshgrid(np.linspace(-2.5, -50, 120), np.linspace(-14, 14, 90), indexing="ij")
    y = ground(x, z)
    for wide, high in ((5.0, 0.08), (1.7, 0.03)):
        phase = random.uniform(0, 2 * np.pi, 2)
        y += high * np.sin(x / wide * 2 + phase[0]) * np.sin(z / wide + phase[1])
    return grid(np.stack([x, y, z], axis=2), tone=SNOW)


def ground(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Height of the ground without its drifts."""
    return -1.15 + 0.042 * (-z - 5) + 0.0 * x


def cap(wide: float, deep: float, high: float, random: np.random.Generator) -> Body:
    """A cushion of snow on a ledge: along x, its foot at y = 0."""
    u, a = np.meshgrid(np.linspace(-1, 1, 60), np.linspace(0, np.pi, 16), indexing="ij")
    ends = np.sqrt(np.clip(1 - np.abs(u) ** 8, 0, 1))
    lumps = np.interp(u[:, 0], np.linspace(-1, 1, 12), random.uniform(0.7, 1.15, 12))[:, None]
    points = [u * wide / 2, high * lumps * ends * np.sin(a) ** 0.8, deep / 2 * ends * np.cos(a)]
    return grid(np.stack(points, axis=2), tone=SNOW)


def flakes(near: float, far: float, params: dict, random: np.random.Generator) -> Body:
    """Flakes between two distances from the lens, in what it sees and beyond by the way of a second."""
    margin = 0.6
    half = np.array([0.118 * far + margin / 2, 0.075 * far + margin])
    count = round(params["flakes_per_m3"] * 4 * half[0] * half[1] * (far - near))
    places = random.uniform(-1, 1, (count, 3)) * [*half, 0.5] - [0, 0, 0.5]
    places[:, 2] = -near + (far - near) * (places[:, 2])
    inside = np.abs(places[:, :2]) < -places[:, 2:] * [0.118, 0.075] + [margin / 2, margin]
    made = []
    corner = np.linspace(0, 2 * np.pi, 7)
    for place in places[inside.all(axis=1)]:
        size = params["flake_mm"] * 0.5e-3 * random.lognormal(0, 0.3)
        ragged = size * random.uniform(0.55, 1.25, 7)
        ragged[-1] = ragged[0]
        disc = np.stack([ragged * np.cos(corner), ragged * np.sin(corner), 0 * corner], axis=1)
        bent = 0.4 * size * random.standard_normal()
        turn = turning(random.standard_normal(3), float(random.uniform(0, 360)))
        made.append(placed(grid(np.stack([disc, 0 * disc + [0, 0, bent]])), place, turn=turn))
    return joined(made)
