"""Pictures of the skin of a hand, float32, row 0 on top: reflectance in 0..1, roughness, relief in metres."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from hand import Hand
from scipy import ndimage
from surfaces import cloudy, noise

ROWS, COLUMNS = 880, 660  # a texel has about 0.4 mm; a pixel sees 0.8 mm
STEPS = np.linspace(0, 1, 7)  # places within a quad from which texels learn where they are
# Lines of the palm (x, y) for a hand whose knuckle of the middle finger lies at (10, 95).
PALM_LINES = (
    ((31, 84), (16, 77), (3, 62), (-2, 44), (2, 24), (9, 10)),  # round the ball of the thumb
    ((33, 76), (14, 70), (-8, 60), (-28, 46), (-34, 40)),
    ((18, 92), (8, 80), (-8, 74), (-26, 73), (-38, 72)),
    ((-16, 4), (0, 1), (16, 5)),
    ((-18, -3), (0, -6), (18, -3)),
)
VEINS = (
    ((24, 10), (18, 34), (20, 58), (26, 80)),
    ((2, -60), (4, -10), (8, 30), (2, 52), (-1, 84)),
    ((8, 30), (14, 58), (21, 84)),
    ((-14, -60), (-12, -8), (-8, 26), (-14, 56), (-19, 82)),
    ((2, 52), (-8, 60), (-14, 56)),
)


class Skin(NamedTuple):
    """Reflectance, roughness, and relief (m), each (ROWS, COLUMNS)."""

    grey: np.ndarray
    rough: np.ndarray
    relief: np.ndarray


class _Map:
    """What lies under each texel while the hand is at rest: its place (mm), the way it faces, its nail."""

    def __init__(self, hand: Hand) -> None:
        values = np.column_stack([hand.rest, hand.rest_normals[:, 2], hand.nails, hand.uv])[hand.quads]
        s, t = (a.ravel()[None, :, None] for a in np.meshgrid(STEPS, STEPS))
        corners = (values[:, k, None] for k in range(4))
        weights = ((1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t)
        all_ = sum(w * c for w, c in zip(weights, corners, strict=True)).reshape(-1, 7)
        row = ((1 - all_[:, 6]) * ROWS).astype(int).clip(0, ROWS - 1)
        column = (all_[:, 5] * COLUMNS).astype(int).clip(0, COLUMNS - 1)
        at = row * COLUMNS + column
        size = ROWS * COLUMNS
        count = np.bincount(at, minlength=size).reshape(ROWS, COLUMNS).astype(float)
        wide = ndimage.gaussian_filter(count, 2.0)
        held = []
        for k in range(5):
            total = np.bincount(at, all_[:, k], minlength=size).reshape(ROWS, COLUMNS)
            filled = ndimage.gaussian_filter(total, 2.0) / np.maximum(wide, 1e-9)
            held.append(np.where(count > 0, total / np.maximum(count, 1), filled).astype(np.float32))
        self.active = np.flatnonzero(wide > 1e-3)  # texels that some part of the hand shows, or nearly
        x, y, z, facing, nail = (layer.ravel()[self.active] for layer in held)
        self.place = np.stack([x, y, z], axis=1)
        self.upwards = np.argsort(y)
        self.heights = y[self.upwards]
        self.palm = np.clip(0.5 + 1.2 * facing, 0, 1)
        self.nail = np.clip((nail - 0.45) * 6, 0, 1)

    def picked(self, picture: np.ndarray) -> np.ndarray:
        """The values of a picture at the active texels."""
        return picture.ravel()[self.active]

    def pictured(self, values: np.ndarray, elsewhere: float) -> np.ndarray:
        """A picture of values at the active texels."""
        picture = np.full(ROWS * COLUMNS, elsewhere, dtype=np.float32)
        picture[self.active] = values
        return picture.reshape(ROWS, COLUMNS)

    def around(self, middle: np.ndarray, reach: float) -> np.ndarray:
        """Which active texels lie within ``reach`` of a point."""
        near = np.flatnonzero((np.abs(self.place - middle) < reach).all(axis=1))
        return near[np.linalg.norm(self.place[near] - middle, axis=1) < reach]

    def line(self, points: np.ndarray, width: float) -> np.ndarray:
        """A soft line through points (x, y), 1 along its middle."""
        near = np.full(len(self.active), np.inf, dtype=np.float32)
        for a, b in pairwise(np.asarray(points, dtype=np.float32)):
            low, high = np.minimum(a, b) - 3 * width, np.maximum(a, b) + 3 * width
            rows = slice(*np.searchsorted(self.heights, (low[1], high[1])))
            here = self.upwards[rows]
            x = self.place[here, 0]
            here = here[(x > low[0]) & (x < high[0])]
            off = self.place[here, :2] - a
            part = np.clip((off @ (b - a)) / max(float((b - a) @ (b - a)), 1e-6), 0, 1)
            near[here] = np.minimum(near[here], np.hypot(*(off - part[:, None] * (b - a)).T))
        return np.exp(-((near / width) ** 2))


def skin(tone: float, hand: Hand, age_years: float, random: np.random.Generator) -> Skin:
    """A paler palm with its lines; a back with veins, knuckles, fine furrows and spots; creases, nails."""
    under, shape = _Map(hand), (ROWS, COLUMNS)
    age = float(np.clip((age_years - 20) / 55, 0, 1))
    palm, back = under.palm, 1 - under.palm
    pale = max(tone, 0.45 * tone + 0.20)
    clouds = 1 + 0.07 * cloudy(shape, 22, 3, random) + 0.05 * cloudy(shape, 80, 2, random)
    for _ in range(int(40 + 260 * age)):
        spot = random.uniform(0, ROWS), random.uniform(0, COLUMNS)
        _blot(clouds, spot, size=random.uniform(1, 3.5), depth=random.uniform(0.03, 0.16))
    grey = under.picked(clouds)
    furrows = [np.abs(noise(shape, (ROWS / a, COLUMNS / b), random)) for a, b in ((5, 6), (6, 4), (9, 8))]
    net = np.clip(1 - 5 * np.minimum(np.minimum(furrows[0], furrows[1]), 1.3 * furrows[2]), 0, 1)
    net = under.picked(net)
    ridges = np.sin(2 * np.pi * (under.place[:, 1] / 0.95 + 2.5 * under.picked(noise(shape, (12, 12), random))))
    relief = -0.045 * net * (back + 0.5 * palm) + 0.008 * ridges * palm
    grey *= 1 - 0.11 * net * (0.5 + 0.5 * back)
    across, along = _creases(under, hand, random)
    grey *= 1 - 0.26 * across - 0.10 * along
    relief -= 0.28 * across + 0.10 * along
    for joint in hand.joints[:, 1:3].reshape(-1, 3):  # darker knuckles
        grey *= 1 - 0.10 * back * np.exp(-(((under.place - joint) / 9) ** 2).sum(axis=1))
    for tip in hand.joints[:, 3]:
        grey *= 1 - 0.07 * np.exp(-(((under.place - tip) / 11) ** 2).sum(axis=1))
    scale = hand.joints[2, 0, 1] / 95.0
    for points in PALM_LINES:
        bent = (np.asarray(points) + random.normal(0, 1.0, (len(points), 2))) * scale
        deep = under.line(_bowed(bent), 0.75) * palm
        grey *= 1 - 0.27 * deep
        relief -= 0.35 * deep
    for _ in range(26):
        start = random.uniform((-36, 6), (34, 88)) * scale
        faint = under.line(np.array([start, start + random.normal(0, 7, 2)]), 0.5) * palm
        grey *= 1 - 0.10 * faint
        relief -= 0.08 * faint
    for points in VEINS:
        bent = (np.asarray(points, dtype=float) + random.normal(0, 2.0, (len(points), 2))) * scale
        vein = under.line(_bowed(bent), 2.2) * back
        grey *= 1 - 0.05 * vein
        relief += (0.25 + 0.35 * age) * vein
    for k in range(1, 5):  # tendons
        relief += 0.30 * under.line(np.array([[2, 8], hand.joints[k, 0, :2] - [0, 6]]), 2.6) * back
    grey *= back * tone + palm * pale
    rough = under.picked(0.47 + 0.06 * cloudy(shape, 40, 3, random))
    _nails(grey, rough, relief, under, hand, tone)
    return Skin(
        under.pictured(np.clip(grey, 0.03, 0.75), tone),
        under.pictured(np.clip(rough, 0.2, 0.7), 0.5),
        under.pictured(1e-3 * relief, 0.0),
    )


def _bowed(points: np.ndarray) -> np.ndarray:
    """More points on a smooth curve through the given ones."""
    at = np.linspace(0, len(points) - 1, 4 * len(points))
    knots = np.arange(len(points))
    curve = np.stack([np.interp(at, knots, points[:, k]) for k in range(2)], axis=1)
    return np.concatenate([points[:1], ndimage.uniform_filter1d(curve, 5, axis=0, mode="nearest"), points[-1:]])


def _creases(under: _Map, hand: Hand, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Deep creases across the joints, and finer ones beside them, 0..1."""
    deep, fine = np.zeros(len(under.active), np.float32), np.zeros(len(under.active), np.float32)
    wobble = under.picked(noise((ROWS, COLUMNS), (ROWS / 14, COLUMNS / 14), random))
    for number, finger in enumerate(hand.joints):
        for k in range(1 if number == 0 else 0, 3):
            way = finger[k + 1] - finger[max(k - 1, 0)]
            here = under.around(finger[k], 17 if k else 26)
            along = (under.place[here] - finger[k]) @ (way / np.linalg.norm(way)) + 0.45 * wobble[here]
            palm = under.palm[here]
            for place in (0.0, 1.9) if k else (21.0, 23.0):
                deep[here] += palm * np.exp(-(((along - place - random.normal(0, 0.3)) / 0.5) ** 2))
            if not k:
                continue
            for place in np.arange(-5.5, 5.6, 1.5) + random.normal(0, 0.25, 8):
                line = (1 - palm) * np.exp(-(((along - place) / 0.42) ** 2))
                deep[here] += 0.8 * float(np.exp(-((place / 4) ** 2))) * line
                fine[here] += line
            for place in random.uniform(-7, 7, 5):
                fine[here] += palm * np.exp(-(((along - place) / 0.35) ** 2))
    return np.clip(deep, 0, 1), np.clip(fine, 0, 1)


def _blot(grey: np.ndarray, middle: tuple[float, float], *, size: float, depth: float) -> None:
    """Darkens a soft round spot, in place."""
    reach = int(3 * size) + 1
    rows, columns = (slice(max(int(at) - reach, 0), int(at) + reach + 1) for at in middle)
    here = grey[rows, columns]
    if here.size:
        r, c = np.ogrid[: here.shape[0], : here.shape[1]]
        off = (r + rows.start - middle[0]) ** 2 + (c + columns.start - middle[1]) ** 2
        here *= 1 - depth * np.exp(-off / (1.2 * size**2))


def _nails(grey: np.ndarray, rough: np.ndarray, relief: np.ndarray, under: _Map, hand: Hand, tone: float) -> None:
    """Nails: glossy, pale, a half-moon, a white edge, a dark rim; all in place."""
    rim = np.clip(4 * under.nail * (1 - under.nail), 0, 1)
    bed = 0.55 * tone + 0.16
    for finger in hand.joints:
        way = (finger[3] - finger[2]) / np.linalg.norm(finger[3] - finger[2])
        here = under.around(finger[3], 17)
        here = here[under.nail[here] > 0.02]
        away = under.place[here] - finger[3]
        nail, along = under.nail[here], away @ way
        low, high = np.percentile(along[nail > 0.5], [2, 98])
        part = (along - low) / (high - low)
        aside = np.linalg.norm(away - along[:, None] * way, axis=1)
        moon = 1 / (1 + np.exp(np.clip((part - 0.26 + 0.004 * aside**2) / 0.03, -30, 30)))
        edge = 1 / (1 + np.exp(np.clip((0.90 - part) / 0.02, -30, 30)))
        look = bed * (1 + 0.22 * moon) * (1 - edge) + 0.62 * edge
        grey[here] += nail * (look - grey[here])
        rough[here] += nail * (0.24 - rough[here])
        relief[here] += nail * (0.01 * np.sin(6 * aside) - relief[here])
    grey *= 1 - 0.35 * rim
