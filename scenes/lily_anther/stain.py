"""The section as two layers of absorbance, float32 (row, col): in focus, and shining through from below."""

from __future__ import annotations

import numpy as np
from anatomy import Anther
from pollen import stamp, textures
from rasters import fractal, noise, sampled, soft, splat, strokes
from scipy.ndimage import gaussian_filter
from tissue import Tissue, um
from view import SHAPE, View


def layers(anther: Anther, view: View, params: dict, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Absorbance of the upper and the lower layer."""
    tissue = Tissue(anther, view, random)
    sharp = tissue.absorbance(view, random)
    upper, lower = _slanted(sharp, random)
    _fluid(upper, lower, tissue.sac, sharp, random)
    shared = textures(random)
    for x, y, cut, lift in anther.grains(params["grain_um"], random):
        ripe = float(np.clip(params["ripe"] + random.normal(0, 0.13), 0, 1))
        row, column = view.seen(np.float64(x), np.float64(y))
        stamp(upper, lower, (float(row), float(column)), cut, lift, ripe, shared, random)
    for _ in range(int(params["folds"])):
        _fold(upper, lower, random)
    uneven = 1 + 0.16 * fractal(SHAPE, um(260), 3, random) + 0.05 * noise(SHAPE, um(3), random)
    _dirt(upper, lower, random)
    return (upper * uneven + 0.012).clip(0), (lower * uneven).clip(0)


def _slanted(sharp: np.ndarray, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Walls are not upright: each place is smeared over the section's thickness in its own direction."""
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    lean = [um(2.3) * noise(SHAPE, um(38), random) + um(1.0) * noise(SHAPE, um(14), random) for _ in "xy"]
    deeper = [sampled(sharp, row + t * lean[0], column + t * lean[1]) for t in (0.7, 1.5, 2.4)]
    upper = 0.62 * sharp + 0.25 * deeper[0] + 0.13 * deeper[1]
    lower = 0.16 * deeper[1] + 0.18 * gaussian_filter(deeper[2], um(0.8))
    return upper, lower


def _fluid(
    upper: np.ndarray, lower: np.ndarray, sac: np.ndarray, tissue: np.ndarray, random: np.random.Generator
) -> None:
    """A precipitate in the sacs, droplets of sporopollenin along the tapetum, torn shreds of plasm."""
    inside = soft(-sac - 1.0, 3.0) * (tissue < 0.02)
    clots = fractal(SHAPE, um(24), 4, random)
    threads = np.abs(fractal(SHAPE, um(30), 3, random))
    upper += inside * (0.025 + 0.05 * soft(clots - 0.3, 0.5) * (1 + 0.8 * noise(SHAPE, um(1.5), random)))
    lower += inside * 0.07 * soft(0.05 - threads, 0.08) * soft(clots, 0.6)
    rows, columns = (random.uniform(0, n - 1, 60000) for n in SHAPE)
    away = -sac[rows.astype(int), columns.astype(int)]
    kept = random.random(len(rows)) < np.exp(-(((away + 1) / 5.0) ** 2)) * 0.9 + 0.006 * (away > 0)
    upper += splat(SHAPE, rows[kept], columns[kept], random.uniform(0.5, 3.2, kept.sum()), blur=0.85)


def _fold(upper: np.ndarray, lower: np.ndarray, random: np.random.Generator) -> None:
    """A crease in which the section lies threefold."""
    row, column = np.ogrid[: SHAPE[0], : SHAPE[1]]
    towards, at = random.uniform(0, np.pi), random.uniform(0.15, 0.85, 2) * SHAPE
    c, s = np.float32(np.cos(towards)), np.float32(np.sin(towards))
    u, v = (column - at[1]).astype(np.float32), (row - at[0]).astype(np.float32)
    p, q = c * u + s * v, c * v - s * u
    q += um(14) * np.sin(p / um(70) + random.uniform(0, 6)) + um(2.0) * noise(SHAPE, um(18), random)
    long = um(random.uniform(90, 240))
    half = um(random.uniform(2.5, 5.5)) * np.sqrt(np.clip(1 - (p / long) ** 2, 0, 1))
    there = np.nonzero((half > 0) & (np.abs(q) < half + 1))
    q, half = q[there], half[there]
    over = soft(half - np.abs(q), 1.3)
    mirrored = sampled(upper, there[0] + 2 * q * c, there[1] - 2 * q * s)
    crest = 0.1 * np.exp(-(((np.abs(q) - half) / um(0.8)) ** 2)) * (upper[there] > 0.05)
    upper[there] += over * (0.75 * mirrored + 0.5 * gaussian_filter(upper, um(2))[there] + crest)
    lower[there] *= 1 + 0.3 * over


def _dirt(upper: np.ndarray, lower: np.ndarray, random: np.random.Generator) -> None:
    """Specks of stain and dust, a few shreds, and the faint marks that the knife left."""
    rows, columns = (random.uniform(0, n - 1, 420) for n in SHAPE)
    weight = random.exponential(2.2, 420)
    upper += splat(SHAPE, rows[:260], columns[:260], weight[:260], blur=0.8)
    lower += splat(SHAPE, rows[260:], columns[260:], 4 * weight[260:], blur=1.9)
    starts = random.uniform(0, 1, (7, 2)) * SHAPE
    r, c, which = strokes(
        starts, random.uniform(0, 7, 7), um(random.uniform(8, 60, 7)), bend=random.normal(0, 0.012, 7)
    )
    lower += splat(SHAPE, r, c, random.uniform(0.1, 0.4, 7)[which], blur=1.1)
    towards = random.uniform(0, np.pi)
    row, column = np.ogrid[: SHAPE[0], : SHAPE[1]]
    across = np.cos(towards) * row + np.sin(towards) * column
    marks = gaussian_filter(random.normal(0, 1, 4096), 2.0).astype(np.float32)
    upper *= 1 + 0.06 * marks[(across.astype(np.int32)) % 4096]
