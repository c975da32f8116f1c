"""A folded street map: blocks, streets, a river with bridges, parks, a railway, names and a grid."""

from __future__ import annotations

import numpy as np
from broad_pen import stamp, word
from patterns import cloudy, noise

WIDTH_MM, HEIGHT_MM = 420.0, 297.0
MARGIN_MM = 10.0
BLOCK_MM, AVENUES_MM = (20.0, 13.5), (80.0, 67.5)  # streets and avenues apart, along and across
TITLE_MM, TITLE_ABOVE_MM = (104.0, 32.0), 46.0  # its field, and the middle of it above the lower edge
FIRST = ("MILL", "QUEEN", "HARBOUR", "CHAPEL", "ORCHARD", "MARKET", "STATION", "GARDEN", "CASTLE", "BRIDGE",
         "ABBEY", "LONG", "MEADOW", "CANAL", "TEMPLE", "FOUNDRY", "WILLOW", "NORTH", "SPRING")  # fmt: skip
SECOND = ("STREET", "ROAD", "LANE", "SQUARE", "GATE", "HILL", "ROW", "PLACE", "AVENUE", "WHARF")


def citymap(texel_mm: float, random: np.random.Generator) -> np.ndarray:
    """Reflectance of the sheet, float32 (row, col); the top row first."""
    shape = round(HEIGHT_MM / texel_mm), round(WIDTH_MM / texel_mm)
    y = (np.arange(shape[0], dtype=np.float32)[:, None] + 0.5) * texel_mm
    x = (np.arange(shape[1], dtype=np.float32) + 0.5) * texel_mm
    bent = 7 * noise(shape, (3, 4), random), 7 * noise(shape, (3, 4), random)
    middle = HEIGHT_MM * (0.64 + 0.12 * np.sin(x / 95 + random.uniform(0, 6)) + 0.04 * np.sin(x / 37))
    from_river = y - middle + 0.5 * bent[0]
    # The two banks were laid out at different angles.
    one, other = random.uniform(-0.2, 0.1), random.uniform(0.25, 0.5)
    angle = np.where(from_river < 0, np.float32(one), np.float32(other))
    c, s = np.cos(angle), np.sin(angle)
    u, v = c * x + s * y + bent[0] + 200, c * y - s * x + bent[1] + 300
    grey = _town(u, v, random)
    water = 10.0 + 3.0 * np.sin(x / 53)
    wet = np.abs(from_river) < water
    bridge = np.abs(u % AVENUES_MM[0] - AVENUES_MM[0] / 2) < 2.4
    waves = np.sin(from_river * 3.2 + 0.8 * np.sin(x / 3.1)) > 0.82
    grey[wet] = np.where(waves, 0.34, 0.48)[wet]
    grey[wet & bridge] = 0.86
    grey[np.abs(np.abs(from_river) - water) < 0.35] = 0.14
    _railway(grey, x, y, random)
    _names(grey, texel_mm, random)
    _frame(grey, x, y, texel_mm, random)
    fold = np.minimum(np.abs((x + 52.5) % 105 - 52.5), np.abs((y + 74) % 148.5 - 74))
    shade = 1 - 0.22 * np.exp(-fold / 0.5) + 0.05 * np.sign(np.sin(np.pi * x / 105))
    return np.clip(grey * shade * (1 + 0.05 * cloudy(shape, 7, 4, random)), 0.03, 0.92).astype(np.float32)


def _town(u, v, random) -> np.ndarray:
    """Houses in blocks between streets of three widths, and parks with trees; u, v along the streets (mm)."""
    i, j = (u / BLOCK_MM[0]).astype(np.int64), (v / BLOCK_MM[1]).astype(np.int64)
    per_block = random.random((j.max() + 1, i.max() + 1)).astype(np.float32)[j, i]
    grey = 0.66 + 0.12 * per_block
    plot = (u / 4.0).astype(np.int64) * 193 + (v / 4.5).astype(np.int64) * 71
    house = random.random(1 << 16).astype(np.float32)[plot & 0xFFFF]
    inset = np.abs(u % 4.0 - 2.0) < 0.5 + 1.2 * house
    grey = np.where(inset & (house > 0.35), np.float32(0.40), grey)
    park = per_block > 0.9
    trees = np.hypot(u % 2.9 - 1.4, v % 3.2 - 1.6) < 0.95
    grey = np.where(park, np.where(trees, np.float32(0.33), np.float32(0.58)), grey)
    for (along, across), half, casing in ((BLOCK_MM, 1.1, 0.3), (AVENUES_MM, 2.4, 0.5)):
        from_line = np.minimum(
            np.abs((u + along / 2) % along - along / 2), np.abs((v + across / 2) % across - across / 2)
        )
        grey = np.where(from_line < half + casing, np.float32(0.22), grey)
        grey = np.where(from_line < half, np.float32(0.87), grey)
    return grey


def _railway(grey, x, y, random) -> None:
    line = y - random.uniform(0.15, 0.85) * HEIGHT_MM - 26 * np.sin(x / 70 + random.uniform(0, 6))
    grey[np.abs(line) < 1.3] = 0.07
    grey[(np.abs(line) < 0.8) & (x % 9 < 4.5)] = 0.88


def _names(grey, texel_mm, random) -> None:
    for _ in range(44):
        text = f"{random.choice(FIRST)} {random.choice(SECOND)}"
        ink = word(text, random.choice([3.4, 4.2, 5.6]) / texel_mm)
        if random.random() < 0.35:
            ink = np.rot90(ink)
        row, column = random.random(2) * grey.shape
        halo = np.pad(ink, 3)
        halo = np.max([np.roll(halo, (a, b), (0, 1)) for a in (-3, 0, 3) for b in (-3, 0, 3)], axis=0)
        stamp(grey, halo, row, column, 0.84)
        stamp(grey, ink, row, column, 0.06)


def _frame(grey, x, y, texel_mm, random) -> None:
    """Grid with its letters, a scale bar, a title, and the white margin."""
    grid = np.minimum(x % 42.0, (y + 4) % 42.0) < 0.3
    grey[grid] *= 0.55
    middle = HEIGHT_MM - TITLE_ABOVE_MM
    field = (np.abs(x - WIDTH_MM / 2) < TITLE_MM[0] / 2) & (np.abs(y - middle) < TITLE_MM[1] / 2)
    grey[field] = 0.88
    for text, high, below in (("CITY PLAN", 10.0, -7.5), (f"SHEET {random.integers(2, 40)}", 5.0, 4.0)):
        ink = word(text, high / texel_mm, pen=0.18, contrast=1.8)
        stamp(grey, ink, (middle + below) / texel_mm, WIDTH_MM / 2 / texel_mm, 0.05)
    bar = (np.abs(x - WIDTH_MM / 2) < 40) & (np.abs(y - middle - 11) < 1.1)
    grey[bar] = np.broadcast_to(np.where(x % 16 < 8, 0.06, 0.8), bar.shape)[bar]
    edge = np.minimum(np.minimum(x, WIDTH_MM - x), np.minimum(y, HEIGHT_MM - y))
    grey[edge < MARGIN_MM] = 0.86
    grey[np.abs(edge - MARGIN_MM) < 0.5] = 0.08
    for k, at in enumerate(np.arange(21, WIDTH_MM, 42.0)):
        for row in (5.0, HEIGHT_MM - 5.0):
            stamp(grey, word("ABCDEFGHIJ"[k], 5.6 / texel_mm), row / texel_mm, at / texel_mm, 0.06)
    for k, at in enumerate(np.arange(17, HEIGHT_MM, 42.0)):
        for column in (5.0, WIDTH_MM - 5.0):
            stamp(grey, word(str(k + 1), 5.6 / texel_mm), at / texel_mm, column / texel_mm, 0.06)
