"""Reflectance pictures, float32 in 0..1, row 0 on top: a doll unwound, its music box, boards, wall."""

from __future__ import annotations

import numpy as np
from surfaces import cloudy, noise

TEXEL_MM = 0.11  # a pixel sees 0.44 to 0.56 mm
ROUND_MM, FOOT_MM, TOP_MM = 190.0, 23.0, 150.0  # of a doll's picture: round it, and along its outline


def doll(contrast: float, random: np.random.Generator) -> np.ndarray:
    """Kerchief, face, blouse, apron with roses, bands of leaves and dots; the face is in the middle."""
    columns, rows = round(ROUND_MM / TEXEL_MM), round((TOP_MM - FOOT_MM) / TEXEL_MM)
    x = ((np.arange(columns, dtype=np.float32) + 0.5) * TEXEL_MM - ROUND_MM / 2)[None, :]
    y = (TOP_MM - (np.arange(rows, dtype=np.float32) + 0.5) * TEXEL_MM)[:, None]
    x, y = np.broadcast_arrays(x, y)
    dark, middle, light = (float(random.uniform(*span)) for span in ((0.05, 0.09), (0.16, 0.28), (0.55, 0.68)))
    grey = np.where(y > 88, dark, middle).astype(np.float32)  # kerchief, blouse
    grey[y < 34] = dark
    dots = np.hypot(np.mod(x, 8.6) - 4.3, np.mod(y, 8.6) - 4.3)
    grey[(y > 92) & (dots < 1.5)] = light
    grey[(y > 92) & (np.abs(dots - 2.6) < 0.35)] = middle
    grey[(y > 85) & (y < 92)] = np.where(np.mod(x / 3.5 + y / 3.5, 1) < 0.5, light, dark)[(y > 85) & (y < 92)]
    apron = ((x / 44) ** 2 + ((y - 60) / 27) ** 2 < 1) & (y > 35)
    grey[apron] = light
    rim = np.abs(np.sqrt((x / 44) ** 2 + ((y - 60) / 27) ** 2) - 0.93)
    grey[apron & (rim < 0.05)] = np.where(np.mod(np.arctan2(y - 60, x) * 22, 1) < 0.5, dark, middle)[
        apron & (rim < 0.05)
    ]
    for cx, cy, size in ((0, 62, 13), (-20, 49, 8), (20, 49, 8), (-20, 73, 7.5), (20, 73, 7.5), (0, 43, 6)):
        _rose(grey, x - cx, y - cy, size * float(random.uniform(0.9, 1.08)), (dark, middle, light), random)
    for k in range(9):  # leaves between them
        a, r = 2 * np.pi * k / 9 + float(random.uniform(-0.2, 0.2)), float(random.uniform(21, 26))
        _leaf(grey, x - r * 1.15 * np.cos(a), y - 60 - 0.7 * r * np.sin(a), a, 5.2, dark, light)
    band = np.abs(y - 28.5) < 5
    wave = np.abs(y - 28.5 - 2.6 * np.sin(x * 2 * np.pi / 19)) < 0.7
    grey[band & wave] = light
    grey[np.hypot(np.mod(x, 9.5) - 4.75, y - 28.5 - 2.0 * np.sign(np.sin(x * 2 * np.pi / 19))) < 1.0] = light
    for _ in range(26):  # sprigs round the sides and the back
        side = float(random.uniform(50, 92)) * float(random.choice([-1, 1]))
        _leaf(grey, x - side, y - float(random.uniform(40, 80)), float(random.uniform(0, 6.3)), 4.6, dark, light)
    _face(grey, x, y - 112, (dark, middle, light))
    mean = 0.30
    brush = noise(grey.shape, (rows / 3, columns / 40), random)
    grey = mean + contrast * (grey - mean) * (1 + 0.06 * cloudy(grey.shape, 12, 3, random)) + 0.012 * brush
    return np.clip(grey, 0.03, 0.75).astype(np.float32)


def _rose(
    grey: np.ndarray, x: np.ndarray, y: np.ndarray, size: float, tones: tuple[float, ...], random: np.random.Generator
) -> None:
    """Layers of petals, each a dented round, in alternating tones."""
    near = (np.abs(x) < size) & (np.abs(y) < size)
    r, turn = np.hypot(x[near], y[near]) / size, np.arctan2(y[near], x[near])
    here, phase = grey[near], random.uniform(0, 6)
    for k, part in enumerate((0.95, 0.76, 0.57, 0.40, 0.22)):
        edge = part * (1 - 0.10 * np.abs(np.sin((5 - k) / 2 * turn + phase + 1.1 * k)))
        here[r < edge] = tones[1] if k % 2 == 0 else tones[0]
        here[np.abs(r - edge) < 0.03] = tones[2]
    grey[near] = here


def _leaf(grey: np.ndarray, x: np.ndarray, y: np.ndarray, angle: float, size: float, tone: float, vein: float) -> None:
    near = (np.abs(x) < size) & (np.abs(y) < size)
    u = (x[near] * np.cos(angle) + y[near] * np.sin(angle)) / size
    v = (y[near] * np.cos(angle) - x[near] * np.sin(angle)) / size
    here = grey[near]
    inside = np.abs(v) < 0.36 * np.clip(1 - u**2, 0, 1)
    here[inside] = tone
    here[inside & ((np.abs(v) < 0.035) | (np.abs(np.mod(u * 4 - np.abs(v) * 5, 1)) < 0.16))] = vein
    grey[near] = here


def _face(grey: np.ndarray, x: np.ndarray, y: np.ndarray, tones: tuple[float, ...]) -> None:
    """Round the middle of the face: hair parted in the middle, brows, eyes with lashes, cheeks, mouth."""
    _, middle, light = tones
    inside = (x / 17) ** 2 + (y / 18) ** 2 < 1
    grey[(x / 18.6) ** 2 + (y / 19.6) ** 2 < 1] = middle
    grey[inside] = 0.52
    hair = inside & ((np.hypot(np.abs(x) - 15, y - 13) < 13.5) | (y > 14))
    grey[hair] = np.where(np.mod(np.hypot(np.abs(x) - 22, y - 4) / 1.3, 1) < 0.35, 0.18, 0.08)[hair]
    for side in (-1, 1):
        u = side * x - 6.4
        eye = (u / 3.1) ** 2 + ((y - 0.5) / 1.9) ** 2
        grey[eye < 1] = 0.68
        grey[np.hypot(u, y - 0.5) < 1.75] = 0.12
        grey[np.hypot(u, y - 0.5) < 0.8] = 0.03
        grey[np.hypot(u - 0.6, y - 1.2) < 0.4] = 0.7
        grey[(eye > 1) & (eye < 1.45) & (y > 0.6)] = 0.04
        grey[(np.abs(y - 4.6 + 0.07 * u**2) < 0.42) & (np.abs(u) < 4)] = 0.06
        cheek = np.exp(-((np.hypot(u - 1.6, y + 6) / 2.8) ** 2))
        grey -= np.where(inside, 0.20 * cheek, 0).astype(np.float32)
    grey[(np.abs(x) < 1.5 - 0.6 * np.abs(x)) & (np.abs(y + 4.6) < 0.35)] = 0.2
    smile = (np.abs(y + 9.4 - 0.09 * x**2) < 0.95 * np.sqrt(np.clip(1 - (x / 3.4) ** 2, 0, 1))) & (np.abs(x) < 3.4)
    grey[smile] = 0.12
    grey[np.hypot(x, y + 21) < 2.6] = light
    for side in (-1, 1):  # the knot of the kerchief
        grey[((side * x - 6.5) / 5.6) ** 2 + ((y + 22.5 + 0.25 * side * x) / 2.4) ** 2 < 1] = light


def box(random: np.random.Generator) -> np.ndarray:
    """The side of a music box, unwound: inlaid lozenges; 340 mm × 22 mm."""
    rows, columns = 120, 1800
    y, x = np.mgrid[0:rows, 0:columns] * 0.19
    lozenge = np.abs(np.mod(x, 10) - 5) + np.abs(y - 11.4) * 0.9
    grey = np.where(lozenge < 4, 0.42, 0.11)
    grey[np.abs(lozenge - 4.6) < 0.4] = 0.55
    grey[(y < 2.2) | (y > 20.4)] = 0.07
    return np.clip(grey * (1 + 0.12 * noise((rows, columns), (40, 90), random)), 0.03, 0.7).astype(np.float32)


def boards(random: np.random.Generator) -> np.ndarray:
    """A shelf of planed boards, 0.9 m × 0.9 m, the grain across."""
    n = 1500
    y = np.broadcast_to((np.arange(n, dtype=np.float32) / n)[:, None], (n, n))
    plank = np.floor(y * 7).astype(int)
    bend = noise((n, n), (9, 4), random) + 0.4 * noise((n, n), (30, 8), random)
    rings = np.mod(y * 60 + 2.2 * bend + plank * 0.37, 1)
    grey = random.uniform(0.22, 0.32, 8)[plank] * (
        1.1 - 0.45 * rings**3 + 0.12 * noise((n, n), (n / 2, n / 40), random)
    )
    grey[np.mod(y * 7, 1) < 0.012] *= 0.3
    return np.clip(grey, 0.03, 0.6).astype(np.float32)


def wall(random: np.random.Generator) -> np.ndarray:
    """Wall paper of stripes and small stars, 1.2 m × 0.8 m."""
    rows, columns = 800, 1200
    y, x = np.mgrid[0:rows, 0:columns].astype(np.float32)
    grey = np.where(np.mod(x / 80, 1) < 0.5, 0.42, 0.33)
    u, v = np.mod(x, 80) - 20, np.mod(y + 40 * (np.floor(x / 80) % 2), 80) - 40
    grey[np.abs(u) ** 0.6 + np.abs(v) ** 0.6 < 3.6] = 0.14
    return (grey * (1 + 0.05 * cloudy((rows, columns), 24, 3, random))).astype(np.float32)
