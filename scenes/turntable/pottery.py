"""Pots as turned bodies with handles, feet on the origin, metres; their painting, row 0 on top."""

from __future__ import annotations

import numpy as np
from solids import Body, joined, rounded, tube, turned
from stroke_font import drawn, lines
from surfaces import cloudy, noise

ROUND, TALL = 2400, 1100  # texels round a jar of 0.26 m and up its side of 0.13 m
CLAY, INK = 0.42, 0.05
OUTLINES = {  # radius and height in mm, from the foot; handles: knots of a tube on the right side
    "amphora": ([(0, 0), (19, 0), (19, 4), (15, 7), (26, 22), (36, 42), (35, 56), (24, 68), (15, 76),
                 (14, 86), (20, 92), (17, 92)],
                [(15, 84), (30, 84), (38, 72), (32, 60)]),
    "bowl": ([(0, 0), (22, 0), (22, 5), (18, 9), (34, 24), (42, 42), (44, 58), (46, 62), (42, 62)],
             [(41, 50), (54, 54), (55, 42), (38, 36)]),
    "pitcher": ([(0, 0), (24, 0), (25, 3), (32, 18), (35, 38), (31, 56), (21, 70), (18, 80), (23, 90),
                 (20, 90)],
                [(18, 80), (38, 80), (44, 58), (33, 40)]),
}  # fmt: skip


def pot(form: str) -> tuple[Body, Body]:
    """The turned body, and its handles: two, or one on a pitcher."""
    outline, knots = OUTLINES[form]
    foot, shape = np.array(outline[:4]), rounded(outline[3:-1], steps=7)
    side = 1e-3 * np.concatenate([foot[:-1], shape, outline[-1:], [(outline[-1][0] * 0.9, outline[-1][1] * 0.8)]])
    path = 1e-3 * rounded([(r, y, 0) for r, y in knots], steps=6)
    arms = [tube(path * [way, 1, 1], 0.0036, around=12, tone=0.09) for way in ((1, -1) if form != "pitcher" else (1,))]
    return turned(side, around=144), joined(arms)


def painted(style: str, random: np.random.Generator) -> np.ndarray:
    """Bands of ornament round the jar, some of them figures; brush strokes, crackle and chips."""
    figure = np.zeros((TALL, ROUND), dtype=np.float32)
    kinds = [_meander, _tongues, _waves, _lozenges, _birds]
    tall = random.permutation([90, 120, 150, 210, 180])
    row = 120
    for k, rows in zip(random.permutation(len(kinds)), tall, strict=True):
        if row + rows > TALL - 60:
            break
        figure[row : row + rows] = kinds[k](rows)
        for line in (row - 16, row + rows + 10):
            figure[line : line + 6] = 1
        row += rows + 34
    if style == "light":
        figure = 1 - figure
    stroke = 1 + 0.14 * noise(figure.shape, (TALL / 4, 60), random)
    clay = CLAY * (1 + 0.08 * cloudy(figure.shape, 12, 5, random) + 0.05 * noise(figure.shape, (TALL / 3, 6), random))
    grey = clay + figure * (INK * stroke - clay)
    crackle = np.abs(noise(figure.shape, (30, 66), random)) < 0.012
    grey = np.where(crackle, 0.6 * grey, grey)
    chips = cloudy(figure.shape, 40, 3, random) > 1.05
    return np.clip(np.where(chips, 0.5, grey), 0.02, 0.7)


def _across(rows: int, times: int) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates of a motif that is repeated round the jar: along it and down it, 0..1."""
    u = (np.arange(ROUND) * times / ROUND) % 1
    return np.broadcast_to(u, (rows, ROUND)), np.broadcast_to(np.arange(rows)[:, None] / rows, (rows, ROUND))


def _meander(rows: int) -> np.ndarray:
    key = ("11111110", "10000010", "10111010", "10101010", "10100010", "10111110", "10000000", "11111111")
    cells = np.array([list(row) for row in key], dtype=np.float32)
    u, v = _across(rows, max(round(ROUND / rows), 1))
    return cells[(v * 8).astype(int), (u * 8).astype(int)]


def _tongues(rows: int) -> np.ndarray:
    u, v = _across(rows, 48)
    return (np.hypot((u - 0.5) / 0.36, np.maximum(v - 0.62, 0) / 0.36) < 1).astype(np.float32)


def _waves(rows: int) -> np.ndarray:
    u, v = _across(rows, 22)
    r, a = np.hypot(u - 0.5, v - 0.45), np.arctan2(v - 0.45, u - 0.5)
    spiral = (np.abs((r / 0.13 - a / (2 * np.pi)) % 1 - 0.5) < 0.27) & (r < 0.46)
    return (spiral | (v > 0.9)).astype(np.float32)


def _lozenges(rows: int) -> np.ndarray:
    u, v = _across(rows, 30)
    d = np.abs(u - 0.5) + np.abs(v - 0.5)
    return ((d < 0.16) | ((d > 0.3) & (d < 0.42))).astype(np.float32)


def _birds(rows: int) -> np.ndarray:
    """Water birds in a row: body, neck, head, bill, legs."""
    u, v = _across(rows, 12)
    body = np.hypot((u - 0.45) / 0.30, (v - 0.52) / 0.20) < 1
    wing = (np.hypot((u - 0.42) / 0.20, (v - 0.49) / 0.09) < 1) & (np.hypot((u - 0.42) / 0.16, (v - 0.49) / 0.05) > 1)
    neck = np.abs(u - 0.74 - 0.05 * np.sin(9 * v)) < 0.035
    neck &= (v > 0.14) & (v < 0.5)
    head = np.hypot((u - 0.79) / 0.075, (v - 0.15) / 0.07) < 1
    bill = (np.abs(v - 0.17) < 0.35 * (0.97 - u)) & (u > 0.8) & (u < 0.97)
    legs = (v > 0.68) & (v < 0.96) & ((np.abs(u - 0.40) < 0.014) | (np.abs(u - 0.52) < 0.014))
    return ((body & ~wing) | neck | head | bill | legs).astype(np.float32)


def scale_ring(texels: int = 1400) -> np.ndarray:
    """The plate from above: degrees round its rim, a number each thirty, rings within."""
    at = (np.arange(texels) + 0.5) / texels * 2 - 1
    pieces, numbers = [], []
    for degree in range(0, 360, 2):
        way = np.array([np.cos(np.radians(degree)), np.sin(np.radians(degree))])
        inner = 0.86 if degree % 30 == 0 else 0.90 if degree % 10 == 0 else 0.94
        pieces.append((inner * way, 0.985 * way))
        if degree % 30 == 0:
            right = np.array([way[1], -way[0]])  # letters stand upright for who looks from outside
            for start, stop in lines(str(degree), 0.085, (0.0, 0.0)):
                numbers.append(tuple(p[0] * -right - p[1] * way + 0.79 * way for p in (start, stop)))
    ink = np.maximum(drawn(at, at, pieces, 0.006), drawn(at, at, numbers, 0.013))
    r = np.hypot(at[None, :], at[:, None])
    rings = np.abs(r / 0.1 % 1 - 0.5) < 0.04
    grey = np.where(rings & (r < 0.7), 0.42, 0.58)
    return (grey + ink * (0.05 - grey))[::-1].astype(np.float32)
