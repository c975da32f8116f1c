"""Drops of water on the outside of a pane: x right, y up, the pane at z = 0, water behind it; metres."""

from __future__ import annotations

from typing import Any

import numpy as np
from solids import Body, grid, joined, placed

HALF_M = (0.085, 0.06)  # of the pane that has drops: what the lens sees from the nearest focus, and more
RUNNERS, LANE_M = 6, 0.0036
RINGS, AROUND = 12, 36
LARGEST_M = 6.5e-3  # a larger one runs


def on_pane(params: dict[str, Any], random: np.random.Generator) -> tuple[Body, list[Body]]:
    """The drops that hang, and those that run, each where it is half way through the second."""
    lanes = HALF_M[0] * 0.62 * (np.linspace(-1, 1, RUNNERS) + random.uniform(-0.12, 0.12, RUNNERS))
    heights = random.uniform(-0.022, 0.026, RUNNERS)
    area = 4e2 * HALF_M[0] * HALF_M[1]  # dm^2
    wanted = round(params["drops_per_dm2"] * area)
    widths = np.minimum(1e-3 * params["drop_mm"] * random.lognormal(0, 0.5, wanted), LARGEST_M)
    kept: list[tuple[float, float, float]] = []
    grown = np.zeros((0, 3))
    for width in np.sort(widths)[::-1]:
        for x, y in random.uniform(-1, 1, (6, 2)) * HALF_M:
            free = np.hypot(grown[:, 0] - x, grown[:, 1] - y) > 0.54 * (grown[:, 2] + width)
            swept = np.abs(lanes - x) < LANE_M + width / 2
            if free.all() and not swept.any():
                kept.append((x, y, width))
                grown = np.array(kept)
                break
    kept += [bead for x, y in zip(lanes, heights, strict=True) for bead in _trail(x, y, random)]
    still = joined([placed(drop(w, params["contact_deg"], random), [x, y, 0]) for x, y, w in kept])
    runners = []
    for x, y in zip(lanes, heights, strict=True):
        body = drop(random.uniform(4.2e-3, 5.6e-3), params["contact_deg"], random, long=1.35)
        runners.append(placed(body, [x, y, 0]))
    return still, runners


def _trail(x: float, y: float, random: np.random.Generator) -> list[tuple[float, float, float]]:
    """Beads that a runner left behind on its way down: place and width of each."""
    made, above = [], y + 0.012
    while above < HALF_M[1]:
        width = 1e-3 * random.uniform(0.5, 1.5)
        made.append((x + 4e-4 * random.standard_normal(), above, width))
        above += width * 0.6 + random.exponential(1.6e-3) + 8e-4
    return made


def drop(width: float, contact_deg: float, random: np.random.Generator, *, long: float = 1.0) -> Body:
    """A drop of this width round the origin: its flat side on the pane towards +z, its cap behind.

    The cap meets the pane at the contact angle, and sags as it is larger; the outline is a wavy circle. Cap
    and flat side share no vertex, so that the rim stays sharp.
    """
    angle = np.linspace(0, 2 * np.pi, AROUND + 1)
    waves = random.normal(0, [0.05, 0.035, 0.02], (2, 3))
    outline = 1 + sum(a * np.cos(k * angle) + b * np.sin(k * angle) for k, a, b in zip((2, 3, 4), *waves, strict=True))
    radius = 0.5 * width * outline
    sag = min(width / LARGEST_M, 1.0)
    share = np.sin(np.linspace(0, np.pi / 2, RINGS + 1))[:, None]
    rise = np.tan(np.radians(contact_deg) / 2) * 0.5 * width  # of a spherical cap of this contact angle
    x = share * radius * np.cos(angle)
    y = share * radius * np.sin(angle) * long
    lean = 1 - 0.35 * sag * share * np.sin(angle)  # thicker below
    z = -rise * (1 - share**2) * lean
    z *= 1 - 0.15 * share**2 * (1 - share) * sag
    cap = np.stack([x, y, z], axis=2)
    flat = np.stack([x[[0, -1]], y[[0, -1]], 0 * x[[0, -1]]], axis=2)
    return joined([grid(cap[::-1][:, ::-1]), grid(flat[::-1])])
