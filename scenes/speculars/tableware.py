"""Cutlery, baubles, a plate, a candlestick, sequins, pearls; metres, the cloth is y = 0."""

from __future__ import annotations

import cutlery
import numpy as np
from solids import Body, ball, grid, joined, placed, rounded, tube, turned, turning


def place_setting(z: float, random: np.random.Generator) -> Body:
    """Fork and spoon beside the card, more of them behind."""
    made = []
    for kind, x, back, yaw in (
        (cutlery.fork, -0.047, -0.085, 5), (cutlery.spoon, 0.047, -0.080, -7),
        (cutlery.knife, 0.068, -0.16, 3), (cutlery.spoon, -0.085, -0.26, 24),
        (cutlery.fork, 0.02, -0.38, -35),
    ):  # fmt: skip
        shift = [x + random.normal(0, 0.003), 0, z + back + random.normal(0, 0.006)]
        made.append(placed(kind(), shift, turn=turning([0, 1, 0], yaw + float(random.normal(0, 2.5)))))
    return joined(made)


def baubles(z: float, random: np.random.Generator) -> Body:
    """Glass balls with caps, silvered, behind the card and beside it."""
    made = []
    for x, back, r in (
        (-0.056, -0.10, 0.016),
        (0.072, -0.12, 0.019),
        (-0.040, -0.21, 0.019),
        (0.050, -0.30, 0.024),
        (-0.15, -0.40, 0.026),
    ):
        at = np.array([x + random.normal(0, 0.004), r, z + back + random.normal(0, 0.008)])
        turn = turning([0, 0, 1], float(random.uniform(-70, 70))) @ turning([1, 0, 0], float(random.uniform(-50, 50)))
        body = ball((0, 0, 0), r, rings=48, around=96)
        neck = turned([(0.30 * r, 0.93 * r), (0.30 * r, 1.16 * r), (0.05 * r, 1.22 * r), (0.0, 1.22 * r)], around=32)
        made.append(placed(joined([body, neck]), at, turn=turn))
    return joined(made)


def candlestick(z: float, random: np.random.Generator) -> tuple[Body, Body]:
    """A brass stick behind the card, and its candle."""
    at = np.array([0.035 + random.normal(0, 0.01), 0, z - 0.20])
    outline = rounded(
        [
            (0.036, 0.0),
            (0.036, 0.002),
            (0.030, 0.004),
            (0.010, 0.009),
            (0.006, 0.016),
            (0.009, 0.022),
            (0.006, 0.028),
            (0.005, 0.05),
            (0.010, 0.056),
            (0.016, 0.062),
            (0.015, 0.064),
            (0.0115, 0.064),
        ],
        steps=10,
    )
    wax = turned(
        [(0.0110, 0.05), (0.0110, 0.115), (0.0100, 0.118), (0.004, 0.116), (0.0, 0.1155)], around=64, tone=0.72
    )
    return placed(turned(outline), at), placed(wax, at)


def plate(z: float) -> Body:
    """Glazed stoneware, its rim beside the card."""
    outline = rounded(
        [
            (0.0, 0.004),
            (0.055, 0.004),
            (0.062, 0.006),
            (0.068, 0.012),
            (0.088, 0.017),
            (0.092, 0.0175),
            (0.0925, 0.0165),
            (0.089, 0.0155),
            (0.066, 0.009),
            (0.06, 0.0),
        ],
        steps=8,
    )
    return placed(turned(outline, around=160), (-0.115, 0, z - 0.23))


def sequins(z: float, random: np.random.Generator) -> Body:
    """Confetti of foil, discs of 3 to 5 mm a little bent, strewn in front and behind."""
    made = []
    for count, middle, spread in (
        (46, (0.0, 0.075), (0.055, 0.020)),
        (60, (0.0, -0.10), (0.10, 0.05)),
        (60, (0.0, -0.32), (0.16, 0.10)),
    ):
        for _ in range(count):
            x, back = np.array(middle) + random.normal(0, 1, 2) * spread
            r = random.uniform(0.0014, 0.0024)
            a = np.linspace(0, 2 * np.pi, 13)
            ring = np.stack([np.sin(a), 0 * a, np.cos(a)], axis=1)
            bent = random.normal(0, 0.10)
            disc = np.stack([0.02 * ring, 0.55 * ring, ring]) * r
            disc[..., 1] += bent * disc[..., 0] ** 2 / r
            body = grid(disc[::-1])
            turn = turning(random.normal(0, 1, 3) * [1, 0.2, 1], float(abs(random.normal(0, 12))))
            made.append(placed(body, (x, 0.0012, z + back), turn=turn))
    return joined(made)


def pearls(z: float, random: np.random.Generator) -> Body:
    """A string of glass pearls before the card, another behind."""
    made = []
    for back, start, stop in ((0.052, -0.075, -0.012), (-0.15, -0.02, 0.14)):
        x, phase = start, random.uniform(0, 6)
        while x < stop:
            r = random.uniform(0.0026, 0.0030)
            made.append(ball((x, r, z + back + 0.010 * np.sin(70 * x + phase)), r, rings=20, around=36))
            x += 1.75 * r
    return joined(made)


def wire(places: np.ndarray) -> Body:
    """The flex of a string of lights through their places (n, 3)."""
    path = rounded(places - np.array([0, 0.004, 0]), steps=10)
    return tube(path, 0.0009, around=6, tone=0.05)
