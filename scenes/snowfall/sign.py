"""The sign's boards as pictures: weathered wood, painted letters; float32 in 0..1, row 0 on top."""

from __future__ import annotations

import numpy as np
from letters import drawn, lines
from surfaces import cloudy, noise

BOARD_M, TEXEL_M = (0.62, 0.15), 0.0007  # a pixel sees 2.4 mm to 3.1 mm
PLACES = ("GROSSALM", "SEEHAUS", "ST. VEIT", "MILL", "NORTH RIDGE", "TARN", "OLD BRIDGE", "PASS")


def boards(count: int, random: np.random.Generator) -> np.ndarray:
    """All boards, one over the other, the first at the bottom."""
    names = random.choice(PLACES, count, replace=False)
    dark = bool(random.random() < 0.5)
    return np.concatenate([_board(str(name), dark, random) for name in names])[::-1]


def _board(name: str, dark: bool, random: np.random.Generator) -> np.ndarray:
    """One board, its first row at the bottom."""
    x, y = ((np.arange(round(s / TEXEL_M)) + 0.5) * TEXEL_M - s / 2 for s in BOARD_M)
    shape = y.size, x.size
    grain = noise(shape, (shape[0] / 3, shape[1] / 90), random)
    rings = np.sin(24 * (y[:, None] / BOARD_M[1] + 0.3 * cloudy(shape, 3, 3, random)))
    grey = (0.12 if dark else 0.34) * (1 + 0.22 * grain + 0.10 * rings + 0.12 * cloudy(shape, 12, 4, random))
    cracks = np.abs(noise(shape, (26, 5), random)) < 0.02
    grey[cracks & (noise(shape, (8, 10), random) > 0.1)] *= 0.3
    words = f"{name} {random.integers(1, 9)}.{random.integers(0, 9)}"
    ink = drawn(x, y, lines(words, min(0.066, 0.46 / len(words)), (-0.02, 0.0)), 0.0105)
    worn = np.clip(1.15 + 0.7 * cloudy(shape, 40, 3, random), 0.1, 1)
    grey += ink * worn * ((0.68 if dark else 0.05) - grey)
    rim = np.minimum(BOARD_M[0] / 2 - np.abs(x)[None, :], BOARD_M[1] / 2 - np.abs(y)[:, None])
    grey *= np.where(np.abs(rim - 0.012) < 0.0016, 0.45, 1.0)
    rime = cloudy(shape, 60, 3, random) + 1.5 * np.clip(0.02 - rim, 0, 1) / 0.02 > 1.15  # snow that sticks
    grey[rime] = 0.75
    return np.clip(grey, 0.03, 0.85).astype(np.float32)
