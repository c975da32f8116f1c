"""Brickwork and a posted bill as pictures of reflectances, row 0 on top; metres."""

from __future__ import annotations

from typing import Any

import numpy as np
from broad_pen import stamp, word
from surfaces import cloudy, noise

BRICK_M, JOINT_M, TEXEL_M = (0.215, 0.065), 0.010, 0.0008  # a pixel sees 1.3 mm and more
COURSES = 12  # of the picture, which repeats
TITLES = ("CONCERT", "CIRCUS", "GRAND BALL", "REGATTA", "FLOWER SHOW", "CYCLE RACE", "SILENT FILM")
PLACES = ("TOWN HALL", "OLD MILL", "CITY GARDEN", "KING'S THEATRE", "HARBOUR", "MARKET SQUARE")


def bricks(params: dict[str, Any], random: np.random.Generator) -> tuple[np.ndarray, tuple[float, float]]:
    """The picture, and its width and height (m)."""
    pitch = BRICK_M[0] + JOINT_M
    half = pitch / 2
    size = 10 * pitch * (1.5 if params["bond"] == "flemish" else 1.0), COURSES * (BRICK_M[1] + JOINT_M)
    shape = round(size[1] / TEXEL_M), round(size[0] / TEXEL_M)
    sand = noise(shape, (shape[0] / 3, shape[1] / 3), random)
    grey = params["mortar"] * (1 + 0.16 * cloudy(shape, 90, 4, random) + 0.10 * sand)
    pits = noise(shape, (shape[0] / 2, shape[1] / 2), random)
    rough = 1 + 0.12 * cloudy(shape, 120, 4, random) + 0.09 * pits
    ragged = 1.6 * cloudy(shape, 160, 2, random)
    rows, columns = np.arange(shape[0])[:, None], np.arange(shape[1])[None, :]
    for course in range(COURSES):
        top = course * (BRICK_M[1] + JOINT_M)
        for left, wide in _course(params["bond"], course, size[0], pitch=pitch, half=half):
            tone = params["clay"] * random.lognormal(0, 0.17) * (0.45 if random.uniform() < 0.06 else 1.0)
            a, b = (left + JOINT_M / 2) / TEXEL_M, (left + wide - JOINT_M / 2) / TEXEL_M
            c, d = (top + JOINT_M / 2) / TEXEL_M, (top + BRICK_M[1] + JOINT_M / 2) / TEXEL_M
            part = np.s_[max(int(c) - 4, 0) : int(d) + 5, max(int(a) - 4, 0) : int(b) + 5]
            y, x = rows[part[0]], columns[:, part[1]]
            inside = np.minimum(np.minimum(x - a, b - x), np.minimum(y - c, d - y)) + ragged[part]
            cover = np.clip(inside, 0, 1)
            shade = np.where(inside < 3.5, 0.72, 1.0)  # arris
            grey[part] += cover * (tone * shade * rough[part] - grey[part])
    grey *= 1 - 0.3 * np.clip(cloudy(shape, 7, 5, random) - 0.2, 0, 1)
    bloom = np.clip(1.6 * cloudy(shape, 10, 5, random) - 0.8, 0, 1)
    return np.clip(grey + 0.5 * bloom * (0.55 - grey), 0.03, 0.7), size


def _course(bond: str, course: int, length: float, *, pitch: float, half: float) -> list[tuple[float, float]]:
    """Left ends and widths, joint included, of the bricks of a course."""
    if bond == "english":
        pattern = [pitch] if course % 2 else [half]
        start = -half / 2 if course % 2 else 0.0
    elif bond == "flemish":
        pattern, start = [pitch, half], -(0.75 * pitch) * (course % 2)
    else:
        pattern, start = [pitch], -half * (course % 2)
    made, left, k = [], start, 0
    while left < length:
        made.append((left, pattern[k % len(pattern)]))
        left, k = left + pattern[k % len(pattern)], k + 1
    return made


def bill(size_m: tuple[float, float], random: np.random.Generator) -> np.ndarray:
    """A letterpress bill: lines of type of many sizes, rules, wrinkles, a torn strip."""
    high, wide = round(size_m[1] / TEXEL_M * 1.25), round(size_m[0] / TEXEL_M * 1.25)
    paper, ink = random.uniform(0.55, 0.72), random.uniform(0.04, 0.09)
    page = np.full((high, wide), paper, dtype=np.float32)
    title = str(random.choice(TITLES))
    texts = [
        (f"{random.integers(1, 29)}. {random.choice(['MAY', 'JUNE', 'JULY', 'AUGUST'])}", 0.05),
        (title, 0.11),
        (f"AT THE {random.choice(PLACES)}", 0.045),
        (f"{random.integers(100, 900)} {random.choice(['PLAYERS', 'DANCERS', 'LAMPS', 'HORSES'])}", 0.075),
        ("DOORS OPEN AT " + str(random.integers(5, 9)), 0.04),
        (f"SEATS {random.integers(1, 9)}.50 AND {random.integers(10, 20)}.00", 0.05),
        ("PRINTED BY MARTENS & SONS", 0.022),
    ]
    row = 0.06 * high
    for text, tall in texts:
        height = tall * high
        drawn = word(text, height, pen=0.19, contrast=1.5)
        if drawn.shape[1] > 0.9 * wide:
            height *= 0.9 * wide / drawn.shape[1]
            drawn = word(text, height, pen=0.19, contrast=1.5)
        stamp(page, drawn, row + 0.5 * tall * high, wide / 2, ink)
        row += 1.42 * tall * high
        rule = np.s_[round(row) : round(row) + max(2, high // 220), wide // 8 : -wide // 8]
        page[rule] = ink
        row += 0.028 * high
    page[[*range(8, 13)], 8:-8] = page[[*range(-13, -8)], 8:-8] = ink
    page[8:-8, 8:13] = page[8:-8, -13:-8] = ink
    fibres = noise(page.shape, (high / 2, wide / 2), random)
    page *= 1 + 0.08 * cloudy(page.shape, 6, 5, random) + 0.06 * fibres
    creases = np.abs(noise(page.shape, (9, 5), random)) < 0.012
    return np.clip(np.where(creases, 0.75 * page, page), 0.03, 0.8)
