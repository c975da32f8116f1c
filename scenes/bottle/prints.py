"""Pictures of the scene, float32, row 0 on top: the label, the garden before the window, painted wood."""

from __future__ import annotations

import numpy as np
from stroke_font import drawn, lines

Shape = tuple[int, int]
LABEL_MM, LABEL_TEXEL_MM = (34.0, 28.0), 0.08  # a pixel sees 0.36 to 0.40 mm
PAPER, INK = 0.72, 0.05
NAMES = ["OLIVA", "OLIO N 7", "LECCINO", "SOLE MIO", "OLEUM", "LA COLLINA", "VERDE", "MASSERIA"]


def noise(shape: Shape, cells: tuple[float, float], random: np.random.Generator) -> np.ndarray:
    """Smooth value noise in -1..1 with so many lattice cells down and across."""
    lattice = random.uniform(-1, 1, [int(n) + 2 for n in cells]).astype(np.float32)
    for axis in (0, 1):
        at = np.arange(shape[axis], dtype=np.float32) * np.float32(cells[axis] / shape[axis])
        first = at.astype(np.int64)
        part = at - first
        part *= part * (3 - 2 * part)
        part = part[:, None] if axis == 0 else part
        here = np.take(lattice, first, axis=axis)
        lattice = here + part * (np.take(lattice, first + 1, axis=axis) - here)
    return lattice


def cloudy(shape: Shape, cells: float, octaves: int, random: np.random.Generator) -> np.ndarray:
    """Octaves of noise, each twice as fine and 0.6 times as strong, about -1..1; cells across the first."""
    high = cells * shape[0] / shape[1]
    layers = (0.6**k * noise(shape, (high * 2**k, cells * 2**k), random) for k in range(octaves))
    return sum(layers, np.zeros(shape, dtype=np.float32))


def label(random: np.random.Generator) -> np.ndarray:
    """Reflectance of a printed paper label: a name, a sun over hills, small print, a bar code, wear."""
    wide, high = LABEL_MM
    x, y = (((np.arange(round(side / LABEL_TEXEL_MM)) + 0.5) * LABEL_TEXEL_MM).astype(np.float32) for side in LABEL_MM)
    shape = y.size, x.size
    fibre = noise(shape, (high / 0.25, wide / 0.25), random)
    grey = np.full(shape, PAPER, dtype=np.float32)
    _landscape(grey, x, y, random)
    middle = wide / 2
    name = NAMES[int(random.integers(len(NAMES)))]
    size = min(4.6, 26 / (0.95 * len(name)))
    ink = drawn(x, y, lines(name, size, (middle, 10.4)), 0.16 * size)
    ink = np.maximum(ink, drawn(x, y, lines("EXTRA VIRGIN OLIVE OIL", 1.15, (middle, 6.6)), 0.22))
    ink = np.maximum(ink, drawn(x, y, lines("0.1 L  PRESSED IN THE HILLS", 0.85, (middle, 4.7)), 0.17))
    lot = f"L{random.integers(1000, 9999)}  {random.integers(1, 29)}.{random.integers(1, 13)}.2031"
    ink = np.maximum(ink, drawn(x, y, lines(lot, 0.9, (9.5, 2.5)), 0.18))
    bars = random.random(46) < 0.5
    place = np.floor((x - 20.0) / 0.21).astype(int)
    inside = (place >= 0) & (place < bars.size)
    code = np.zeros(x.size, dtype=np.float32)
    code[inside] = bars[place[inside]]
    ink[(y > 1.4) & (y < 3.7)] = np.maximum(ink[(y > 1.4) & (y < 3.7)], code)
    rim = np.minimum(np.minimum(x[None, :], wide - x[None, :]), np.minimum(y[:, None], high - y[:, None]))
    ink = np.maximum(ink, (np.abs(rim - 0.75) < 0.14) | (np.abs(rim - 1.15) < 0.07))
    grey += ink * (INK - grey)
    rubbed = cloudy(shape, 9, 5, random) > 1.15
    grey[rubbed] += 0.6 * (PAPER - grey[rubbed])
    return np.clip(grey * (1 + 0.05 * fibre), 0.03, 0.85).astype(np.float32)[::-1]


def _landscape(grey: np.ndarray, x: np.ndarray, y: np.ndarray, random: np.random.Generator) -> None:
    """The upper half of the label, as an engraving: a sun with rays, ruled hills; in place."""
    up, across = y[:, None], x[None, :]
    sun = random.uniform(9, 23), random.uniform(19.5, 21.0)
    angle, away = np.arctan2(up - sun[1], across - sun[0]), np.hypot(up - sun[1], across - sun[0])
    ink = (np.sin(angle * 22) > 0.35) & (away > 3.0)
    ink |= np.abs(away - 2.4) < 0.12
    for ridge in range(3):
        steps = np.arange(4)
        waves = np.sin(x[:, None] * 0.35 * 1.8**steps + random.uniform(0, 6, 4)) * 1.5 * 0.5**steps
        line = 19.0 - 1.9 * ridge + waves.sum(axis=1)
        under = up - line[None, :]
        spacing = 0.55 - 0.08 * ridge
        ruled = np.mod(under * 0.9 + 0.35 * np.sin(across * (0.8 + 0.3 * ridge)), spacing) < 0.24
        ink = np.where(under < 0, ruled | (under > -0.22), ink)
    upper = (up > 13.4) & (up < 23.9) & (across > 1.1) & (across < LABEL_MM[0] - 1.1)
    grey[upper & ink] = INK


def garden(shape: Shape, blur: float, random: np.random.Generator) -> np.ndarray:
    """Relative radiance in 0..1 of what lies out of the window: sky, trees, a house, a hedge.

    It is smoothed with this standard deviation (cells), for it is farther away than the picture hangs.
    """
    up, across = (np.linspace(0, 1, n, dtype=np.float32) for n in shape)
    up, across = up[:, None], across[None, :] * shape[1] / shape[0]
    sky = 0.80 + 0.20 * up + 0.10 * cloudy(shape, 3, 4, random)
    leaves = cloudy(shape, 24, 4, random)
    grey = sky
    for _ in range(7):
        middle, crown = random.uniform(0, across.max()), random.uniform(0.10, 0.22)
        height = random.uniform(0.34, 0.62)
        rough = 0.035 * leaves + 0.05 * noise(shape, (14, 20), random)
        tree = np.hypot(across - middle, 0.8 * (up - height)) + rough < crown
        tree |= (np.abs(across - middle) < 0.014) & (up < height)
        grey = np.where(tree, random.uniform(0.22, 0.36) * (1 + 0.35 * leaves), grey)
    left = random.uniform(0.2, across.max() - 0.4)
    house = (np.abs(across - left) < 0.17) & (up < 0.42 + 0.0 * across)
    roof = (up >= 0.42) & (up < 0.58 - 0.9 * np.abs(across - left))
    window = (np.mod((across - left) / 0.085 + 0.5, 1) > 0.45) & (np.mod(up / 0.14, 1) > 0.5) & house
    grey = np.where(house, 0.62, np.where(roof, 0.24, grey))
    grey = np.where(window, 0.16, grey)
    hedge = up + 0.02 * noise(shape, (8, 40), random) < 0.20
    grey = np.clip(np.where(hedge, 0.20 * (1 + 0.4 * leaves), grey), 0.03, 1)
    return _smoothed(_smoothed(grey, blur).T, blur).T[::-1]


def _smoothed(rows: np.ndarray, blur: float) -> np.ndarray:
    """Convolved down the columns with a Gaussian of this standard deviation (rows)."""
    at = np.arange(-round(3 * blur), round(3 * blur) + 1)
    kernel = np.exp(-((at / blur) ** 2) / 2)
    padded = np.pad(rows, ((at[-1], at[-1]), (0, 0)), mode="edge")
    return sum(k * padded[n : n + len(rows)] for n, k in enumerate(kernel / kernel.sum())).astype(np.float32)


def sill(shape: Shape, random: np.random.Generator) -> np.ndarray:
    """White painted wood: brush marks along it, grain that shows through, chips and rings of old glasses."""
    brush = noise(shape, (shape[0] / 3, shape[1] / 220), random)
    grey = 0.58 * (1 + 0.06 * brush + 0.05 * cloudy(shape, 5, 4, random))
    row, column = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    for _ in range(5):
        at = random.uniform(0, 1, 2) * shape
        away = np.hypot(row - at[0], column - at[1]) / (0.13 * shape[0])
        grey *= 1 - 0.22 * np.exp(-(((away - 1) / 0.035) ** 2)) * (noise(shape, (9, 9), random) > -0.3)
    chips = cloudy(shape, 30, 4, random) > 1.12
    grey[chips] = 0.20
    return np.clip(grey, 0.05, 0.8).astype(np.float32)
