"""Knitted cloth as a picture of reflectances."""

from __future__ import annotations

import numpy as np
from surfaces import noise

LOOPS = (8, 11)
"""Loops of one repeat, across and down."""


def stitch(tone: float, random: np.random.Generator) -> np.ndarray:
    """One repeat of stocking stitch, 8 loops across and 11 down, its yarn of many threads."""
    rows, columns = 880, 640
    y, x = np.mgrid[0:rows, 0:columns].astype(np.float32)
    across, down = x / 80, y / 80
    slant = np.abs(np.mod(across, 1) - 0.5)
    loop = 0.5 + 0.5 * np.sin(2 * np.pi * (down + 0.9 * slant))
    body = np.clip(1.25 - 2.2 * np.abs(slant - 0.25), 0, 1)
    thread = noise((rows, columns), (220, 210), random)
    return np.clip(tone * (0.42 + 0.72 * loop * body) * (1 + 0.25 * thread), 0.015, 0.85).astype(np.float32)
