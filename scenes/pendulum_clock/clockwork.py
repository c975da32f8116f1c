"""The clock's bodies and faces: pendulum with its bob, dial, case. Millimetres, the front towards +z."""

from __future__ import annotations

import numpy as np
from broad_pen import word
from solids import Body, ball, box, grid, joined, placed, tube, turned, turning
from surfaces import cloudy, noise

TEXEL_MM = 0.3  # a pixel sees 0.8 mm
ROMAN = ("XII", "I", "II", "III", "IIII", "V", "VI", "VII", "VIII", "IX", "X", "XI")


def bob(radius: float) -> Body:
    """A lens of brass with a raised rim; its picture is laid on along z."""
    edge = [(0, -9), (0.7, -7), (1, -1.5), (1, 1.5), (0.97, 3), (0.93, 2.6), (0.9, 3.2)]
    outline = [(radius * r, y) for r, y in edge]
    outline += [(radius * r, 3.2 + 6.5 * (1 - (r / 0.9) ** 2)) for r in np.linspace(0.85, 0.0, 14)]
    made = placed(turned(outline, around=128), turn=turning([1, 0, 0], 90))
    return made._replace(uv=made.vertices[:, :2] / (2 * radius) + 0.5)


def disc(radius: float) -> Body:
    """The dial's plate; its picture is laid on along z."""
    made = placed(turned([(radius, -2), (radius, 0), (0, 0)], around=128), turn=turning([1, 0, 0], 90))
    return made._replace(uv=made.vertices[:, :2] / (2 * radius) + 0.5)


def bezel(radius: float) -> Body:
    """The ring round the dial."""
    outline = [(radius + a, y) for a, y in ((-1, -2), (6, -2), (6, 3), (4, 5), (1, 5), (-1.5, 1))]
    return placed(turned(outline, around=128), turn=turning([1, 0, 0], 90))


def engraved(kind: str, radius: float, random: np.random.Generator) -> np.ndarray:
    """Reflectance, relative, of the bob: fine turning, and rings, a rayed star or engine-turned waves."""
    n = round(2 * radius / TEXEL_MM)
    y, x = np.mgrid[n - 1 : -1 : -1, 0:n].astype(np.float32)
    x, y = ((a + 0.5) / n * 2 - 1 for a in (x, y))
    r, turn = np.hypot(x, y), np.arctan2(y, x)
    grey = 1 + 0.10 * noise((1, 4096), (1, 900), random)[0][np.clip(r * 4000, 0, 4095).astype(int)]
    if kind == "rings":
        for place in (0.2, 0.34, 0.38, 0.6, 0.64, 0.82):
            grey *= 1 - 0.6 * np.exp(-(((r - place) * radius / 0.7) ** 2))
    elif kind == "star":
        ray = np.abs(np.mod(turn * 16 / (2 * np.pi) + 0.5, 1) - 0.5) * 2  # 0 along a ray
        grey *= np.where((ray < 1 - r / 0.72) & (r < 0.72), 0.5, 1.0)
        grey *= 1 - 0.6 * np.exp(-(((r - 0.78) * radius / 0.8) ** 2))
        grey[r < 0.16] *= 1.25
    else:
        wave = np.sin(2 * np.pi * (r * radius / 3.2 + 0.22 * np.sin(18 * turn)))
        grey *= np.where((r < 0.8) & (r > 0.18), 1 - 0.4 * np.clip(1.5 * wave, 0, 1), 1.0)
    return grey * (1 - 0.12 * np.clip(cloudy((n, n), 4, 4, random), 0, 1))


def rods(kind: str, top: float, radius: float) -> dict[str, Body]:
    """The rod down to the bob at the origin: five of brass and steel, or one of wood; the tip."""
    tip = joined(
        [
            tube([(0, -radius - 14, 0), (0, -radius + 3, 0)], 2.2),
            turned([(0, -radius - 9), (6, -radius - 9), (6, -radius - 4), (0, -radius - 4)], around=36),
            tube([(0, -radius - 15, 0), (0, -radius - 26, 0)], [1.8, 0.5]),
        ]
    )
    if kind == "wood":
        return {"wood": box((-6, radius * 0.8, -3), (6, top, 3)), "tip": tip}
    steel = [tube([(x, radius * 0.8, 0), (x, top, 0)], 2.2) for x in (-14, 0, 14)]
    brass = [tube([(x, radius + 12, 0), (x, top, 0)], 2.4) for x in (-7, 7)]
    bars = [box((-18, y - 4, -3.4), (18, y + 4, 3.4)) for y in (radius + 10, radius + 64)]
    screws = [
        ball((x, y, 3.4), (1.6, 1.6, 1), rings=8, around=16) for y in (radius + 10, radius + 64) for x in (-14, 0, 14)
    ]
    return {"steel": joined(steel), "brass": joined([*brass, *bars]), "tip": joined([tip, *screws])}


def dial(radius: float, random: np.random.Generator) -> np.ndarray:
    """An enamelled dial, reflectance: Roman numerals, a track of minutes, hairlines."""
    n = round(2 * radius / TEXEL_MM)
    y, x = np.mgrid[n - 1 : -1 : -1, 0:n].astype(np.float32)
    x, y = ((a + 0.5) / n * 2 * radius - radius for a in (x, y))
    r, turn = np.hypot(x, y), np.arctan2(x, y)
    grey = 0.74 * (1 + 0.015 * cloudy((n, n), 8, 3, random))
    for place in (0.95, 0.90):
        grey[np.abs(r - place * radius) < 0.35] = 0.06
    minute = np.abs(np.mod(turn * 60 / (2 * np.pi) + 0.5, 1) - 0.5) * r * 2 * np.pi / 60
    five = np.mod(np.round(turn * 60 / (2 * np.pi)), 5) == 0
    grey[(minute < np.where(five, 0.9, 0.4)) & (r < 0.95 * radius) & (r > 0.90 * radius)] = 0.06
    for k, text in enumerate(ROMAN):
        cut = word(text, 17 / TEXEL_MM, pen=0.16, contrast=3.0)
        angle = k * np.pi / 6
        u = (x * np.cos(angle) - y * np.sin(angle)) / TEXEL_MM + cut.shape[1] / 2
        v = (0.76 * radius - (x * np.sin(angle) + y * np.cos(angle))) / TEXEL_MM + cut.shape[0] / 2
        inside = (u >= 0) & (v >= 0) & (u < cut.shape[1] - 1) & (v < cut.shape[0] - 1)
        ink = cut[v[inside].astype(int), u[inside].astype(int)]
        grey[inside] += ink * (0.05 - grey[inside])
    return np.clip(grey, 0.04, 0.8).astype(np.float32)


def scale(random: np.random.Generator) -> np.ndarray:
    """An ivory plate with lines for the swing, 120 mm × 18 mm: reflectance."""
    y, x = np.mgrid[0:60, 0:400].astype(np.float32) * TEXEL_MM
    grey = 0.55 * (1 + 0.05 * noise((60, 400), (20, 9), random))
    off = np.abs(np.mod(x - 60 + 2, 4) - 2)
    long = np.where(np.mod(np.round((x - 60) / 4), 5) == 0, 12.0, 7.0)
    grey[(off < 0.35) & (y < long) & (np.abs(x - 60) < 50)] = 0.06
    return grey


def wood(shape: tuple[int, int], tone: float, random: np.random.Generator) -> np.ndarray:
    """Grain along the columns, in wavering flames."""
    x = np.arange(shape[1], dtype=np.float32)
    bent = x / shape[1] * 26 + 2.4 * noise(shape, (3, 4), random) + 0.5 * noise(shape, (14, 9), random)
    grey = 0.78 + 0.22 * np.sin(2 * np.pi * bent) + 0.25 * noise(shape, (shape[0] / 40, shape[1] / 2.5), random)
    return np.clip(tone * grey, 0.015, 0.6).astype(np.float32)


def plate(wide: float, high: float, z: float) -> Body:
    """An upright rectangle about the origin, its front towards +z."""
    w, h = wide / 2, high / 2
    return grid([[(-w, -h, z), (w, -h, z)], [(-w, h, z), (w, h, z)]])
