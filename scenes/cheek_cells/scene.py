"""Unstained cells of the inner cheek in saliva: flat scales with a nucleus and folds, and bacteria on them.

They delay light and take almost none of it away, so in focus they hardly show.
"""

from __future__ import annotations

from typing import Any

import numpy as np

SIZE_UM = (420.0, 300.0)  # width, height; the field of 400 × 250 pixels of 20 µm is 320 × 200
TEXEL_UM = 0.3
NUCLEUS_UM, NUCLEUS_INDEX = 2.6, 0.012  # thickness of the nucleus; its index, less that of the cell
REACH_UM = 60.0  # from the middle of a cell, beyond its edge
ABSORBED = 0.004  # of the light, by a cell


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Transmission (0 to 1) and optical path (nm) of the section."""
    random = np.random.default_rng([2713, int(params["seed"])])
    columns, rows = (round(size / TEXEL_UM) for size in SIZE_UM)
    x = (np.arange(columns) - (columns - 1) / 2) * TEXEL_UM
    y = ((rows - 1) / 2 - np.arange(rows)) * TEXEL_UM
    wrinkles = _band(random, (rows, columns), 2.5, 9.0)
    grain = _band(random, (rows, columns), 0.5, 1.4)
    index, thickness = params["index"], params["thickness_um"]
    path, cover = np.zeros((rows, columns)), np.zeros((rows, columns))
    for middle in _places(random, round(params["cells"])):
        near = tuple(slice(*np.searchsorted(s, (-REACH_UM, REACH_UM))) for s in (middle[1] - y, x - middle[0]))
        inside, nucleus, folds = _cell(random, x[near[1]] - middle[0], (y[near[0]] - middle[1])[:, None])
        scale = thickness * random.uniform(0.8, 1.25)
        height = inside * (scale * (1 + 0.16 * wrinkles[near] + 0.05 * grain[near]) + 0.5 * folds)
        path[near] += index * height + nucleus * (index + NUCLEUS_INDEX) * NUCLEUS_UM
        cover[near] = np.maximum(cover[near], inside)
    path += _bacteria(random, x, y, cover, count=round(params["bacteria"]))
    return {
        "transmission": 1 - ABSORBED * cover,
        "path_nm": 1e3 * path,
        "texel_um": TEXEL_UM,
        "height_um": params["height_um"],
    }


def _places(random: np.random.Generator, count: int) -> list[np.ndarray]:
    """Middles of cells (µm), each the farthest from the others among a few tries; one near the middle."""
    half = np.array(SIZE_UM) / 2
    found = [random.uniform(-0.15, 0.15, 2) * half]
    while len(found) < count:
        tries = random.uniform(-1, 1, (6, 2)) * half
        gaps = [min(np.hypot(*(one - other)) for other in found) for one in tries]
        found.append(tries[int(np.argmax(gaps))])
    return found


def _cell(random: np.random.Generator, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cover, height of the nucleus and height of folds of a cell (0 to 1), at places round its middle."""
    angle, radius = np.arctan2(y, x), np.hypot(x, y)
    size = random.uniform(24, 36)
    edge = np.full_like(angle, size)
    for order in range(2, 8):
        edge += size * 0.22 / order * random.normal() * np.cos(order * angle + random.uniform(0, 2 * np.pi))
    inside = _step((edge - radius) / 0.9)
    rolled = np.exp(-(((edge - radius) / 1.5 - 1.2) ** 2)) * random.uniform(0.2, 0.9)
    off = random.uniform(-0.15, 0.15, 2) * size
    turn, long, wide = random.uniform(0, np.pi), random.uniform(4.2, 5.6), random.uniform(3.2, 4.2)
    u = ((x - off[0]) * np.cos(turn) + (y - off[1]) * np.sin(turn)) / long
    v = ((y - off[1]) * np.cos(turn) - (x - off[0]) * np.sin(turn)) / wide
    nucleus = np.sqrt(np.clip(1 - u * u - v * v, 0, None)) * _step((1 - np.hypot(u, v)) * wide / 0.6)
    spot = np.hypot(u - 0.3, v + 0.2)
    nucleus = nucleus + 0.25 * np.exp(-((spot / 0.22) ** 2))
    folds = rolled
    for _ in range(random.integers(1, 4)):
        towards = random.uniform(0, 2 * np.pi)
        at = random.uniform(0.2, 0.8) * size
        bend = random.uniform(-0.008, 0.008)
        along, across = x * np.cos(towards) + y * np.sin(towards), y * np.cos(towards) - x * np.sin(towards)
        folds = folds + random.uniform(0.3, 1.0) * np.exp(-(((along - at - bend * across**2) / 0.8) ** 2))
    return inside, nucleus * inside, folds


def _bacteria(
    random: np.random.Generator, x: np.ndarray, y: np.ndarray, cover: np.ndarray, *, count: int
) -> np.ndarray:
    """Optical path (µm) of rods and balls, most of them on cells."""
    path = np.zeros(cover.shape)
    placed = 0
    while placed < count:
        at = random.uniform(-0.5, 0.5, 2) * SIZE_UM
        column, row = int(np.abs(x - at[0]).argmin()), int(np.abs(y - at[1]).argmin())
        if random.uniform() > 0.1 + 0.9 * cover[row, column]:
            continue
        placed += 1
        half, turn = random.choice([0.0, 0.7, 1.2]), random.uniform(0, np.pi)
        reach = round(3.2 / TEXEL_UM)
        here = (slice(max(row - reach, 0), row + reach), slice(max(column - reach, 0), column + reach))
        dx, dy = x[here[1]][None, :] - at[0], y[here[0]][:, None] - at[1]
        along = dx * np.cos(turn) + dy * np.sin(turn)
        gap = np.hypot(along - np.clip(along, -half, half), dy * np.cos(turn) - dx * np.sin(turn))
        path[here] += 0.055 * 0.8 * np.exp(-((gap / 0.45) ** 2))
    return path


def _step(x: np.ndarray) -> np.ndarray:
    """A smooth step from 0 to 1."""
    return 1 / (1 + np.exp(-np.clip(4 * x, -60, 60)))


def _band(random: np.random.Generator, shape: tuple[int, int], short_um: float, long_um: float) -> np.ndarray:
    """Noise of rms 1 with waves of these lengths."""
    fy, fx = np.fft.fftfreq(shape[0], TEXEL_UM)[:, None], np.fft.rfftfreq(shape[1], TEXEL_UM)
    f = np.hypot(fx, fy)
    keep = np.exp(-((f * short_um) ** 2)) - np.exp(-((f * long_um) ** 2))
    noise = np.fft.irfft2(np.fft.rfft2(random.normal(size=shape)) * keep, shape)
    return noise / noise.std()
