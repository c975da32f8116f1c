"""Pictures of skin and eyes, float32, row 0 on top: reflectance in 0..1, and relief in metres."""

from __future__ import annotations

from typing import NamedTuple

import hair
import numpy as np
from person import SKULL, Person
from scipy import ndimage
from surfaces import cloudy, noise

ROWS, COLUMNS = 1000, 1500  # a texel has about 0.4 mm on the face; a pixel sees 1.2 mm
TOP_MM, FOOT_MM = 130.0, -270.0
COARSE = 2  # texels of the masks, across


class Skin(NamedTuple):
    """Reflectance, roughness, and relief (m), each (ROWS, COLUMNS)."""

    grey: np.ndarray
    rough: np.ndarray
    relief: np.ndarray


def unwound(vertices: np.ndarray) -> np.ndarray:
    """Coordinates (n, 2) on the pictures, wound round the upright axis of the head, their seam behind."""
    turn = np.arctan2(vertices[:, 0], vertices[:, 2] - SKULL[2]) / (2 * np.pi) + 0.5
    return np.stack([turn, (vertices[:, 1] - FOOT_MM) / (TOP_MM - FOOT_MM)], axis=1)


class _Map:
    """What lies under each texel: its place (mm), and masks."""

    def __init__(self, person: Person) -> None:
        shape = ROWS // COARSE, COLUMNS // COARSE
        away = person.vertices - [0, 0, SKULL[2]]
        level = np.hypot(away[:, 0], away[:, 2])
        outer = (person.normals[:, [0, 2]] * away[:, [0, 2]]).sum(axis=1) > 0.1 * level
        keep = outer & (person.masks["mouth"] < 0.6)
        at = (unwound(person.vertices[keep]) * [shape[1], shape[0]]).astype(int)
        at = (shape[0] - 1 - at[:, 1]).clip(0, shape[0] - 1), at[:, 0].clip(0, shape[1] - 1)
        values = {"r": level} | person.masks
        values["scalp"] = hair.density(person, person.vertices) * (person.masks["ears"] < 0.3)
        count = np.zeros(shape)
        np.add.at(count, at, 1)
        self.held = {}
        blurred = [ndimage.gaussian_filter(count, sigma) for sigma in (0.9, 5)]
        for name, value in values.items():
            total = np.zeros(shape)
            np.add.at(total, at, value[keep])
            fine, wide = (
                ndimage.gaussian_filter(total, s) / np.maximum(c, 1e-9) for s, c in zip((0.9, 5), blurred, strict=True)
            )
            self.held[name] = ndimage.zoom(np.where(blurred[0] > 0.02, fine, wide), COARSE, order=1).astype(np.float32)
        turn = ((np.arange(COLUMNS, dtype=np.float32) + 0.5) / COLUMNS - 0.5)[None, :] * 2 * np.pi
        self.x = self.held["r"] * np.sin(turn)
        self.z = self.held["r"] * np.cos(turn) + SKULL[2]
        self.y = (TOP_MM - (np.arange(ROWS, dtype=np.float32) + 0.5) * (TOP_MM - FOOT_MM) / ROWS)[:, None]
        self.front = (np.cos(turn) > 0).astype(np.float32)

    def spot(self, x: float, y: float, wide: float, high: float) -> np.ndarray:
        """A soft spot on the face, 1 in its middle."""
        return self.front * np.exp(-(((self.x - x) / wide) ** 2) - ((self.y - y) / high) ** 2)


def skin(tone: float, hair_tone: float, person: Person, random: np.random.Generator) -> Skin:
    """Blotches, freckles, pores, veins and lines; lips, lids, stubble, the ground of hair and brows."""
    under, shape = _Map(person), (ROWS, COLUMNS)
    lips, lids, ears, scalp = (under.held[name] for name in ("lips", "lids", "ears", "scalp"))
    age = float(np.clip((person.age - 20) / 55, 0, 1))
    pores = np.clip(noise(shape, (ROWS / 2.6, COLUMNS / 2.6), random) - 0.25, 0, 1)
    pores *= 0.5 + 0.5 * np.clip(cloudy(shape, 18, 2, random) + under.spot(0, -30, 30, 35) * 2, 0, 1.6)
    fine = np.abs(noise(shape, (ROWS / 4, COLUMNS / 5), random))
    net = np.clip(1 - 6 * np.minimum(fine, np.abs(noise(shape, (ROWS / 5, COLUMNS / 4), random))), 0, 1)
    grey = 1 + 0.07 * cloudy(shape, 26, 3, random) + 0.05 * cloudy(shape, 110, 2, random)
    grey *= 1 - 0.16 * pores - 0.05 * net
    warm = under.spot(48, -38, 24, 20) + under.spot(-48, -38, 24, 20) + 1.1 * under.spot(0, -38, 14, 14) + 0.6 * ears
    grey *= 1 - 0.09 * warm * (1 + 0.5 * noise(shape, (60, 80), random))
    relief = -0.055 * pores - 0.03 * net + 0.02 * noise(shape, (ROWS / 6, COLUMNS / 6), random)
    for eye in person.eyes:
        x, y = float(eye[0]), float(eye[1])
        grey *= 1 - (0.10 + 0.10 * age) * under.spot(x, y - 15, 17, 8) - 0.10 * under.spot(x * 0.55, y - 2, 7, 9)
    grey *= 1 - 0.09 * lids
    lines = _lines(under, person, age, random)
    grey *= 1 - 0.10 * lines
    relief -= 0.22 * (0.35 + age) * lines
    _spots(grey, age, random)
    grey = grey.astype(np.float32)
    creases = np.clip(noise(shape, (14, COLUMNS / 4), random) + 0.2, 0, 1)
    lip_tone = np.interp(tone, [0.1, 0.3, 0.5], [0.92, 0.70, 0.60]) * (1 - 0.16 * creases)
    grey += np.clip(1.15 * lips, 0, 1) * (lip_tone * (1 + 0.04 * cloudy(shape, 80, 2, random)) - grey)
    relief += lips * (-0.10 * creases - relief)
    grey *= tone
    _rims(grey, person, tone)
    if person.male:
        grey = _stubble(grey, under, lips, hair_tone, random)
    brow = sum(
        under.spot(s * (abs(float(e[0])) + 3), float(e[1]) + 22, 20, 4.5)
        for s, e in zip((1, -1), person.eyes, strict=True)
    )
    grey += 0.14 * np.clip(brow, 0, 1) * (min(hair_tone, tone) - grey)
    grey += 0.62 * scalp * (1 - ears) * (min(hair_tone, 0.7 * tone) - grey)
    rough = (
        0.46
        + 0.06 * cloudy(shape, 40, 3, random)
        - 0.12 * lips
        - 0.07 * np.clip(under.spot(0, 40, 45, 25) + under.spot(0, -20, 12, 30), 0, 1)
    )
    return Skin(
        np.clip(grey, 0.02, 0.75).astype(np.float32),
        np.clip(rough, 0.25, 0.65).astype(np.float32),
        (relief * 1e-3).astype(np.float32),
    )


def _lines(under: _Map, person: Person, age: float, random: np.random.Generator) -> np.ndarray:
    """Lines of the forehead, of the neck, beside the eyes: 0..1, wide and soft."""
    shape = ROWS, COLUMNS
    bend = 3.0 * noise(shape, (5, 9), random) + 1.2 * noise(shape, (16, 30), random)
    wave = np.cos((under.y + bend) * 2 * np.pi / 10.5)
    made = np.clip(wave - 0.86, 0, 1) / 0.14 * np.clip(under.spot(0, 54, 46, 20) * 1.3, 0, 1)
    made *= np.clip(0.4 + noise(shape, (30, 24), random), 0, 1)
    neck = np.clip(np.cos((under.y + 2 * bend) * 2 * np.pi / 27) - 0.95, 0, 1) / 0.05
    made += 0.6 * neck * (under.y < -118) * (under.y > -200)
    for side, eye in zip((1, -1), person.eyes, strict=True):
        dx, dy = (under.x - eye[0]) * side - 19, under.y - eye[1] + 3
        fan = np.arctan2(dy, np.maximum(dx, 0.1))
        ray = np.clip(np.cos(fan * 11 + 1.5 * noise(shape, (40, 60), random)) - 0.8, 0, 1) / 0.2
        made += age * ray * np.exp(-(((dx - 9) / 8) ** 2) - (dy / 10) ** 2) * (dx > 0) * under.front
    return np.clip(made, 0, 1).astype(np.float32)


def _spots(grey: np.ndarray, age: float, random: np.random.Generator) -> None:
    """Freckles, spots of age, a few moles; in place."""
    freckled = random.uniform(0, 1) ** 3
    for _ in range(int(250 + 1500 * freckled)):
        _blot(
            grey,
            random.uniform(120, 620),
            random.normal(COLUMNS / 2, COLUMNS / 9),
            random.uniform(0.8, 2.2),
            random.uniform(0.04, 0.16),
        )
    for _ in range(int(60 * age)):
        _blot(
            grey,
            random.uniform(50, 620),
            random.uniform(0.2, 0.8) * COLUMNS,
            random.uniform(2, 6),
            random.uniform(0.04, 0.14),
        )
    for _ in range(int(random.integers(3, 9))):
        _blot(
            grey,
            random.uniform(200, 850),
            random.uniform(0.25, 0.75) * COLUMNS,
            random.uniform(1.6, 3.0),
            random.uniform(0.3, 0.65),
        )


def _blot(grey: np.ndarray, row: float, column: float, size: float, depth: float) -> None:
    reach = int(3 * size) + 1
    rows, columns = (slice(max(int(at) - reach, 0), int(at) + reach + 1) for at in (row, column))
    here = grey[rows, columns]
    if here.size:
        r, c = np.ogrid[: here.shape[0], : here.shape[1]]
        here *= 1 - depth * np.exp(-((r + rows.start - row) ** 2 + (c + columns.start - column) ** 2) / (1.2 * size**2))


def _rims(grey: np.ndarray, person: Person, tone: float) -> None:
    """The roots of the lashes, dark along the lids; in place."""
    line = np.zeros((ROWS, COLUMNS), dtype=np.float32)
    for row, (roots, _) in enumerate(person.lashes):
        at = np.linspace(0, len(roots) - 1, 300)
        path = np.stack([np.interp(at, np.arange(len(roots)), roots[:, k]) for k in range(3)], axis=1)
        uv = unwound(path)
        line[((1 - uv[:, 1]) * ROWS).astype(int), (uv[:, 0] * COLUMNS).astype(int)] = 1.0 if row % 2 else 0.6
    line = np.clip(3.0 * ndimage.gaussian_filter(line, 1.2), 0, 1)
    grey += 0.65 * line * (0.25 * tone - grey)


def _stubble(
    grey: np.ndarray, under: _Map, lips: np.ndarray, hair_tone: float, random: np.random.Generator
) -> np.ndarray:
    """A shaven beard's ground: moustache, chin, jaws, throat."""
    strength = random.uniform(0.1, 1.0)
    y, x = under.y, np.abs(under.x)
    jaw = (
        np.clip((-38 - 0.35 * (62 - x) - y) / 12, 0, 1)
        * np.clip((y + 150) / 30, 0, 1)
        * np.clip((under.z + 95) / 20, 0, 1)
    )
    lip_y = -72
    tash = np.exp(-((x / 30) ** 4) - ((y - lip_y - 17) / 8) ** 2)
    where = np.clip(jaw + tash, 0, 1) * under.front * np.clip(1 - 1.6 * lips, 0, 1)
    dots = np.clip(noise(grey.shape, (ROWS / 2.2, COLUMNS / 2.2), random) + 0.1, 0, 1)
    return grey + strength * where * (0.18 + 0.5 * dots) * (np.minimum(hair_tone, 0.6 * grey) - grey)


def eye(tone: float, random: np.random.Generator) -> np.ndarray:
    """An eye by angle off its axis (rows, 0 on top to pi) and around: white, veins, iris, limbus, pupil."""
    rows, columns = 900, 512
    off = (np.pi * (np.arange(rows, dtype=np.float32) + 0.5) / rows)[:, None]
    around = (np.arange(columns, dtype=np.float32) + 0.5)[None, :] / columns * 2 * np.pi
    veins = np.abs(noise((rows, columns), (26, 22), random) + 0.5 * noise((rows, columns), (60, 40), random))
    white = 0.46 * (1 + 0.04 * cloudy((rows, columns), 12, 2, random)) * (1 - 0.25 * np.clip(1 - 9 * veins, 0, 1))
    white = white * (1 - 0.30 * np.clip((off - 0.55) / 0.5, 0, 1))
    threads = noise((rows, columns), (14, 120), random) + 0.6 * noise((rows, columns), (30, 220), random)
    collar = np.exp(-(((off - 0.26 - 0.02 * np.sin(7 * around)) / 0.05) ** 2))
    iris = tone * (1 + 0.30 * threads + 0.4 * collar) * (1 - 0.45 * np.clip((off - 0.33) / 0.11, 0, 1))
    rim = 1 / (1 + np.exp(-(off - 0.44) / 0.012))
    grey = iris * (1 - rim) + white * rim
    grey = grey * (1 - 0.45 * np.exp(-(((off - 0.44) / 0.028) ** 2)))
    pupil = 1 / (1 + np.exp(-(off - 0.19) / 0.006))
    return np.clip(grey * pupil + 0.012 * (1 - pupil), 0.012, 0.7).astype(np.float32)
