"""Hair of the head, brows and lashes, as fibres. Millimetres, in the frame of the person."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from fibres import Fibres, fibres
from person import SKULL, Person, nearest_on
from scipy import ndimage
from scipy.spatial import KDTree

POINTS = 11
COUNT = {"cropped": 15000, "parted": 13000, "long": 13000, "tied": 13000}
# Polar angle (deg) from the crown at which hair begins, by azimuth (deg) from the face.
HAIRLINE = ([0, 20, 38, 52, 62, 72, 80, 90, 100, 112, 130, 180], [54, 55, 57, 62, 82, 104, 108, 96, 100, 122, 130, 134])


class Skull:
    """How far the skin of the head lies from its middle, by direction; ears are passed over."""

    def __init__(self, person: Person) -> None:
        keep = (person.masks["ears"] < 0.2) & (person.masks["mouth"] < 0.2)
        away = person.vertices[keep] - SKULL
        r = np.linalg.norm(away, axis=1)
        azimuth, polar = _angles(away)
        total = np.zeros((91, 181))
        count = np.zeros_like(total)
        at = (np.round(polar * 180 / np.pi / 2).astype(int), np.round((azimuth + np.pi) * 90 / np.pi).astype(int))
        np.add.at(total, at, r)
        np.add.at(count, at, 1)
        soft = [ndimage.gaussian_filter(a, 1.6, mode=("nearest", "wrap")) for a in (total, count)]
        wide = [ndimage.gaussian_filter(a, 8, mode=("nearest", "wrap")) for a in (total, count)]
        self.table = np.where(soft[1] > 0.02, soft[0] / np.maximum(soft[1], 1e-9), wide[0] / np.maximum(wide[1], 1e-9))

    def radius(self, away: np.ndarray) -> np.ndarray:
        azimuth, polar = _angles(away)
        where = np.stack([polar * 90 / np.pi, (azimuth + np.pi) * 90 / np.pi])
        return ndimage.map_coordinates(self.table, where, order=1, mode="nearest")


def _angles(away: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    unit = away / np.linalg.norm(away, axis=-1, keepdims=True)
    return np.arctan2(unit[..., 0], unit[..., 2]), np.arccos(np.clip(unit[..., 1], -1, 1))


class Roots(NamedTuple):
    """Where hair grows from (n, 3), the way out of the skin there (n, 3), and the skull below."""

    roots: np.ndarray
    outward: np.ndarray
    skull: Skull


def density(person: Person, points: np.ndarray) -> np.ndarray:
    """How densely hair of the head grows at points (n, 3) of the skin, 0..1; less over old men's brows."""
    azimuth, polar = _angles(points - SKULL)
    turn = np.degrees(np.abs(azimuth))
    back = 12 * np.clip((person.age - 30) / 40, 0, 1) if person.male else 0.0
    line = np.interp(turn, *HAIRLINE) - back * np.exp(-(((turn - 28) / 22) ** 2))
    return np.clip((line - np.degrees(polar)) / 5 + 0.5, 0, 1)


def head_hair(style: str, tone: float, person: Person, random: np.random.Generator) -> Fibres:
    """The fibres of a style."""
    roots, outward = _roots(person, COUNT[style], random)
    paths = STYLES[style](Roots(roots, outward, Skull(person)), random)
    tones = np.clip(tone * random.lognormal(0, 0.28, len(paths)), 0.01, 0.6)
    grey = random.uniform(0, 1, len(paths)) < np.clip((person.age - 35) / 45, 0, 0.75)
    tones = np.where(grey, np.clip(tones * 3 + 0.1, 0, 0.5), tones)
    thin = np.interp(np.linspace(0, 1, POINTS), [0, 0.1, 0.7, 1], [0.8, 1, 1, 0.25])
    radius = (0.13 if style == "cropped" else 0.16) * thin[None, :] * random.uniform(0.7, 1.3, (len(paths), 1))
    return fibres(paths, radius=radius, tone=tones, random=random)


def _roots(person: Person, count: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    triangles = person.mesh.triangles
    corners = person.vertices[triangles]
    middle = corners.mean(axis=1)
    ears = person.masks["ears"][triangles].mean(axis=1)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    weight = area * density(person, middle) * (ears < 0.3) * (middle[:, 1] > -75)
    chosen = random.choice(len(weight), count, p=weight / weight.sum())
    share = random.dirichlet([1, 1, 1], count)
    points = np.einsum("nk,nkd->nd", share, corners[chosen])
    return points, person.normals[triangles[chosen, 0]]


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)


def _grown(
    on: Roots, *, length: np.ndarray, lift: np.ndarray,
    way: Callable[[np.ndarray, float], np.ndarray], weight: float, room: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Paths that leave the skin by ``lift``, follow ``way(points, part)``, sag, and lie ``room`` above it."""
    paths = np.empty((len(on.roots), POINTS, 3))
    paths[:, 0] = on.roots - 0.3 * on.outward
    step = length / (POINTS - 1)
    for k in range(1, POINTS):
        part = (k - 1) / (POINTS - 1)
        here = paths[:, k - 1]
        away = _unit(here - SKULL)
        along = way(here, part)
        along = along - (along * away).sum(axis=1, keepdims=True) * away * (1 - part)
        above = np.linalg.norm(here - SKULL, axis=1) - on.skull.radius(here - SKULL) - room
        drawn = np.clip(above / 10, 0, 1.3)[:, None] * (_angles(here - SKULL)[1] < np.radians(118))[:, None]
        along = along - drawn * away * part
        heading = _unit(along) + lift[:, None] * away * (1 - part) ** 2 + weight * part * np.array([0, -1, 0])
        there = here + step[:, None] * _unit(heading)
        off = there - SKULL
        far = np.linalg.norm(off, axis=1)
        least = on.skull.radius(off) + room * min(1.0, 2.5 * k / POINTS)
        polar = _angles(off)[1]
        pushed = (far < least) & (polar < np.radians(125))
        there[pushed] = SKULL + (off * (least / far)[:, None])[pushed]
        paths[:, k] = there
    return paths


def _gathered(paths: np.ndarray, locks: int, strength: float, random: np.random.Generator) -> np.ndarray:
    """Fibres drawn towards the middle of their locks, the more the nearer to the tip; and a little frizz."""
    leaders = random.choice(len(paths), locks, replace=False)
    mine = paths[leaders[KDTree(paths[leaders, 0]).query(paths[:, 0])[1]]]
    pull = strength * np.linspace(0, 1, POINTS)[None, :, None] ** 0.8
    pull = pull * random.uniform(0.5, 1.1, (len(paths), 1, 1))
    frizz = np.cumsum(random.normal(0, 1, paths.shape), axis=1) * np.linspace(0, 1, POINTS)[None, :, None]
    size = np.linalg.norm(np.diff(paths, axis=1), axis=2).mean()
    return paths + pull * (mine - paths) + 0.05 * size * frizz


def _cropped(on: Roots, random: np.random.Generator) -> np.ndarray:
    """Short, longer on top, combed forwards and aside."""
    polar = np.degrees(_angles(on.roots - SKULL)[1])
    length = np.interp(polar, [20, 60, 85, 120], [34, 26, 12, 6]) * random.uniform(0.7, 1.2, len(on.roots))
    side = float(random.choice([-1, 1]))

    def way(points: np.ndarray, part: float) -> np.ndarray:
        del part
        level = np.clip((points[:, 1] - 30) / 50, 0, 1)[:, None]
        fore = np.array([0.45 * side, 0.1, 1.0])
        down = np.stack([0 * points[:, 0], -1 + 0 * points[:, 0], -0.25 + 0 * points[:, 0]], axis=1)
        return level * fore + (1 - level) * down + random.normal(0, 0.35, points.shape)

    lift = np.interp(polar, [20, 60, 100], [1.3, 1.0, 0.35]) * random.uniform(0.6, 1.4, len(on.roots))
    room = random.uniform(0.3, 3.5, len(on.roots)) * np.interp(polar, [20, 80, 110], [2.2, 1, 0.4])
    paths = _grown(on, length=length, lift=lift, way=way, weight=0.3, room=room)
    return _gathered(paths, 900, 0.55, random)


def _falling(on: Roots, random: np.random.Generator, *, reach: float) -> np.ndarray:
    """From a parting to both sides, over or behind the ears, to the collar or beyond."""
    side = float(random.choice([-1, 1]))
    parting = side * random.uniform(8, 30)
    reach *= random.uniform(0.87, 1.13)
    polar = np.degrees(_angles(on.roots - SKULL)[1])
    length = reach * np.interp(polar, [0, 60, 120], [1.15, 1.05, 0.7]) * random.uniform(0.8, 1.1, len(on.roots))
    over = np.sign(on.roots[:, 0] - parting)[:, None]
    wave, phase = random.uniform(0.05, 0.3), random.uniform(0, 6, len(on.roots))

    def way(points: np.ndarray, part: float) -> np.ndarray:
        level = np.clip((points[:, 1] - 25) / 75, 0, 1)[:, None]
        brushed = np.concatenate([over, 0.15 + 0 * over, -0.55 + 0 * over], axis=1)
        down = np.stack([-0.0012 * points[:, 0], -1 + 0 * points[:, 0], -0.12 + 0 * points[:, 0]], axis=1)
        bend = wave * np.sin(9 * part + phase * 0.15 + over[:, 0])[:, None]
        sideways = np.cross(_unit(points - SKULL), [0.0, 1.0, 0.0])
        return level * brushed + (1 - level) * down + bend * sideways + random.normal(0, 0.06, points.shape)

    lift = random.uniform(0.0, 0.4, len(on.roots))
    room = random.uniform(0.5, 7.0, len(on.roots)) * np.interp(polar, [20, 80], [0.7, 1.0])
    paths = _grown(on, length=length, lift=lift, way=way, weight=1.2, room=room)
    return _gathered(paths, 420, 0.5, random)


def _tied(on: Roots, random: np.random.Generator) -> np.ndarray:
    """Combed back to a knot behind the crown; a fifth of the fibres is the knot, a few have slipped out."""
    knot = SKULL + np.array([0.0, 62.0, -88.0])
    gap = np.linalg.norm(knot - on.roots, axis=1)
    length = gap * 1.15 * random.uniform(0.92, 1.0, len(on.roots))

    def way(points: np.ndarray, part: float) -> np.ndarray:
        del part
        return _unit(knot - points) + random.normal(0, 0.05, points.shape)

    room = random.uniform(0.4, 5.0, len(on.roots))
    lift = random.uniform(0.0, 0.35, len(on.roots))
    paths = _grown(on, length=length, lift=lift, way=way, weight=0.0, room=room)
    paths = _gathered(paths, 600, 0.35, random)
    coil = np.arange(len(on.roots)) < len(on.roots) // 5
    frames = np.linalg.qr(random.normal(0, 1, (int(coil.sum()), 3, 3)))[0]
    turn = np.linspace(0, 1, POINTS)[None, :, None] * random.uniform(2.5, 4.5, (len(frames), 1, 1))
    size = random.uniform(15, 27, (len(frames), 1, 1))
    paths[coil] = knot + [0, 14, -16] + size * (np.cos(turn) * frames[:, :1] + np.sin(turn) * frames[:, 1:2])
    loose = random.choice(np.nonzero(~coil)[0], 160, replace=False)
    turn = np.linspace(0, 1, POINTS)[None, :, None]
    wisp = random.normal([0, 2, 0], [12, 14, 12], (160, 1, 3))
    paths[loose] += turn**2 * wisp + 5 * _unit(paths[loose] - SKULL) * turn
    return paths


STYLES: dict[str, Callable[[Roots, np.random.Generator], np.ndarray]] = {
    "cropped": _cropped,
    "parted": partial(_falling, reach=112),
    "long": partial(_falling, reach=295),
    "tied": _tied,
}


def brows(tone: float, person: Person, random: np.random.Generator) -> Fibres:
    """Both brows: short hairs that rise at the nose and lie outwards at the temple."""
    roots, ways, sides = [], [], []
    thick = random.uniform(3.8, 5.6) if person.male else random.uniform(3.0, 4.4)
    arch = random.uniform(1.0, 3.5)
    for side, eye in zip((1, -1), person.eyes, strict=True):
        count = 420
        part = random.beta(1.5, 1.35, count)
        x = abs(eye[0]) - 17 + 42 * part
        middle = (
            eye[1] + 20 + arch * np.sin(np.pi * np.clip(part * 1.05 - 0.1, 0, 1)) - 7 * np.clip(part - 0.68, 0, 1) / 0.3
        )
        wide = thick * np.interp(part, [0, 0.12, 0.5, 1], [0.9, 1.0, 0.8, 0.3])
        y = middle + wide * np.clip(random.normal(0, 0.55, count), -1.4, 1.4)
        points, normals = nearest_on(person, np.stack([side * x, y], axis=1))
        aside = np.interp(part, [0, 0.25, 0.6, 1], [0.25, 0.8, 1.1, 1.2])
        rise = np.interp(part, [0, 0.25, 0.6, 1], [1.0, 0.6, 0.05, -0.45]) - 0.35 * (y - middle) / thick
        way = np.stack([side * aside, rise, 0 * rise], axis=1) + random.normal(0, 0.12, (count, 3))
        roots.append(points)
        ways.append(_unit(way - (way * normals).sum(axis=1, keepdims=True) * normals))
        sides.append(normals)
    root, way, normal = (np.concatenate(part)[:, None] for part in (roots, ways, sides))
    at = np.linspace(0, 1, 5)[None, :, None]
    length = random.uniform(5, 9, (len(root), 1, 1))
    paths = root + length * at * way + length * normal * (0.28 * at - 0.20 * at**2) - 0.2 * normal
    radius = 0.065 * np.array([1, 1, 0.9, 0.6, 0.2])
    return fibres(paths, radius=radius, tone=1.5 * tone * random.lognormal(0, 0.25, len(paths)), random=random)


def lashes(tone: float, person: Person, random: np.random.Generator) -> Fibres:
    """Rows of curved hairs on the lids, longer above."""
    made = []
    for row, (roots, tips) in enumerate(person.lashes):
        upper = row % 2 == 1
        count = 95 if upper else 55
        at = np.sort(random.uniform(0.04, 0.96, count)) * (len(roots) - 1)
        root, tip = (
            np.stack([np.interp(at, np.arange(len(ends)), ends[:, k]) for k in range(3)], axis=1)
            for ends in (roots, tips)
        )
        way = (tip - root) * random.uniform(0.75, 1.15, (count, 1)) * (1.0 if upper else 0.75)
        way += random.normal(0, 0.5, (count, 3))
        curl = (0.35 if upper else -0.25) * np.linalg.norm(way, axis=1)[:, None, None] * np.array([0, 1.0, 0])
        part = np.linspace(0, 1, 6)[None, :, None]
        made.append(root[:, None] + part * way[:, None] + curl * (part**2 - 0.8 * part))
    paths = np.concatenate(made)
    radius = 0.075 * np.array([1.1, 1, 0.9, 0.7, 0.5, 0.2])
    return fibres(paths, radius=radius, tone=min(tone, 0.03), random=random)
