"""The picture of the board's face, float32 in 0..1, row 0 on top: copper under mask, pads, holes, print."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from layout import CLEAR_MM, SIZE_MM, Layout
from stroke_font import drawn
from surfaces import cloudy, noise

TEXEL_MM = 0.009  # a pixel sees 25 µm
TIN, PRINT, HOLE, COPPER_GAIN = 0.52, 0.74, 0.015, 1.9
VIA_MM, DRILL_MM = 0.52, 0.24


def face(layout: Layout, mask: float, random: np.random.Generator) -> np.ndarray:
    """Reflectance of the board with its solder mask, whose reflectance over bare laminate is ``mask``."""
    x, y = ((np.arange(round(s / TEXEL_MM)) + 0.5) * TEXEL_MM - s / 2 for s in SIZE_MM)
    shape = y.size, x.size
    dots = [(at, at + np.array([1e-4, 0.0])) for at in layout.vias]
    traces = _over(drawn(x, y, pieces, width) for width, pieces in layout.copper)
    rings, drill = drawn(x, y, dots, VIA_MM), drawn(x, y, dots, DRILL_MM)
    pads = _rectangles(x, y, layout.pads, 0.0)
    keep = _over(drawn(x, y, pieces, width + 2 * CLEAR_MM) for width, pieces in layout.copper)
    keep = np.maximum(keep, _rectangles(x, y, layout.pads, CLEAR_MM))
    signal = drawn(x, y, dots[: len(dots) * 2 // 3], VIA_MM + 2 * CLEAR_MM)
    poured = 1 - np.maximum(keep, signal)
    copper = np.maximum(np.maximum(traces, rings), poured)
    weave = np.sin(2 * np.pi * x / 0.36)[None, :] * np.sin(2 * np.pi * y / 0.42)[:, None]
    bare = mask * (1 + 0.16 * weave.astype(np.float32) + 0.10 * cloudy(shape, 30, 3, random))
    over = mask * COPPER_GAIN * (1 + 0.08 * cloudy(shape, 60, 3, random))
    grey = bare + copper * (over - bare)
    grey *= 1 - 0.35 * _rim(copper)  # the mask is thin on the edge of copper: a dark line
    fine = noise(shape, (shape[0] / 2.2, shape[1] / 2.2), random)
    grey *= 1 + 0.10 * fine
    grey += drill * (HOLE - grey)
    ink = np.clip(_over(drawn(x, y, pieces, width) for width, pieces in layout.print_), 0, 1)
    ink *= np.clip(1.25 + 0.6 * cloudy(shape, 160, 2, random), 0, 1)
    grey += ink * (PRINT * (1 + 0.05 * fine) - grey)
    tin = TIN * (1 + 0.16 * cloudy(shape, 90, 3, random) + 0.10 * fine)
    grey += pads * (tin - grey)
    grey *= 1 - 0.4 * (1 - pads) * _rectangles(x, y, layout.pads, 0.035)  # the mask's opening round a pad
    for _ in range(26):  # dried flux
        at, radius = random.uniform(-0.5, 0.5, 2) * SIZE_MM, random.uniform(0.08, 0.35)
        r = np.hypot(x[None, :] - at[0], y[:, None] - at[1])
        grey *= 1 + 0.35 * np.exp(-(((r - radius) / 0.012) ** 2)).astype(np.float32)
    return np.clip(grey, 0.01, 0.85).astype(np.float32)[::-1]


def _over(pictures: Iterable[np.ndarray]) -> np.ndarray:
    return np.maximum.reduce(list(pictures))


def _rectangles(x: np.ndarray, y: np.ndarray, pads: np.ndarray, grown: float) -> np.ndarray:
    """Cover of rectangles (centre, half sizes), grown on all sides."""
    cover = np.zeros((y.size, x.size), dtype=np.float32)
    for cx, cy, hx, hy in pads:
        columns = slice(*np.searchsorted(x, (cx - hx - grown, cx + hx + grown)))
        rows = slice(*np.searchsorted(y, (cy - hy - grown, cy + hy + grown)))
        cover[rows, columns] = 1
    return cover


def _rim(cover: np.ndarray) -> np.ndarray:
    """1 within about two texels of an edge."""
    step = sum(np.abs(cover - np.roll(cover, by, axis)) for axis in (0, 1) for by in (-2, 2))
    return np.clip(step, 0, 1)
