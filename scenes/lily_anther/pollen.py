"""Pollen as the cut finds it: a wall of rods under a net, furrow, plasm, nucleus, generative cell."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from rasters import fractal, noise, sampled, soft
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree
from view import SHAPE, TEXEL_UM

TILE = 320  # texels of the textures that all grains share


class Textures(NamedTuple):
    """What the grains sample: the net of the wall, fine and coarse granules, drops."""

    net: np.ndarray
    fine: np.ndarray
    coarse: np.ndarray
    drops: np.ndarray


def textures(random: np.random.Generator) -> Textures:
    """The net has meshes of about 4.5 µm, of uneven size, and beaded walls."""
    shape = TILE, TILE
    mesh = 5.0 / TEXEL_UM
    count = int((TILE / mesh) ** 2)
    points = random.uniform(0, TILE, (count, 2))
    tree = cKDTree(points, boxsize=TILE)
    for _ in range(2):  # towards even meshes, not quite
        grid = np.stack(np.meshgrid(*[np.arange(0, TILE, 2.0)] * 2, indexing="ij"), -1).reshape(-1, 2)
        _, near = tree.query(grid, workers=1)
        moved = (grid - points[near] + TILE / 2) % TILE - TILE / 2
        size = np.maximum(np.bincount(near, minlength=count), 1)
        shift = np.column_stack([np.bincount(near, moved[:, k], minlength=count) / size for k in (0, 1)])
        points = (points + 0.8 * shift) % TILE
        tree = cKDTree(points, boxsize=TILE)
    row, column = np.mgrid[:TILE, :TILE].astype(np.float32)
    row += 1.6 * noise(shape, 7, random)
    column += 1.6 * noise(shape, 7, random)
    far, _ = tree.query(np.stack([row % TILE, column % TILE], -1).reshape(-1, 2), k=2, workers=1)
    edge = TEXEL_UM * 0.5 * (far[:, 1] - far[:, 0]).reshape(shape).astype(np.float32)
    beads = 1 + 0.45 * noise(shape, 2.2, random)
    net = soft(0.62 * beads - edge, 0.7)
    fine, coarse = noise(shape, 1.9, random), fractal(shape, 9, 2, random)
    return Textures(net, fine, coarse, fractal(shape, 6.5, 2, random))


def stamp(
    upper: np.ndarray,
    lower: np.ndarray,
    at: tuple[float, float],
    cut: float,
    lift: float,
    ripe: float,
    shared: Textures,
    random: np.random.Generator,
) -> None:
    """Draw a grain into both layers.

    at : row and column. cut : radius of the cut, µm. lift : height of the cut over the middle, in radii.
    ripe : 0 for a microspore with a thin wall and a vacuole, 1 for pollen with a generative cell.
    """
    span = int((1.25 * cut + 3) / TEXEL_UM) + 2
    row, column = round(at[0]), round(at[1])
    spans = [slice(max(m - span, 0), min(m + span + 1, n)) for m, n in zip((row, column), SHAPE, strict=True)]
    if any(s.stop <= s.start for s in spans):
        return
    v, u = np.mgrid[spans[0], spans[1]].astype(np.float32)
    v, u = TEXEL_UM * (v - np.float32(at[0])), TEXEL_UM * (u - np.float32(at[1]))
    turn, long = random.uniform(0, 2 * np.pi), random.uniform(1.0, 1.2)
    c, s = np.float32(np.cos(turn)), np.float32(np.sin(turn))
    p, q = (c * u + s * v) / np.float32(long), (c * v - s * u) * np.float32(long**0.5)
    r, angle = np.hypot(p, q), np.arctan2(q, p)
    dent = np.exp(-(((np.abs(angle) - np.pi / 2 - 0.0) / random.uniform(0.35, 0.7)) ** 2)) * (angle > 0)
    depth = max(random.normal(0.06, 0.14), -0.03) if random.random() < 0.8 else random.uniform(0.25, 0.6)
    rim = 1 - depth * dent
    for k, share in ((2, 0.03), (3, 0.022), (4, 0.014), (7, 0.008)):
        rim = rim + share * np.sin(k * angle + random.uniform(0, 6))
    inward = (cut * rim - r) * (1 if depth < 0.2 else 0.85)
    slant = np.sqrt(1 - min(abs(lift), 0.95) ** 2)
    coat = (1.5 + 1.9 * ripe) / slant
    furrow = 1 - 0.75 * dent * (depth > 0.02)
    exine = _exine(inward, angle * cut, coat * furrow, shared, random)
    r0, c0 = random.uniform(0, TILE, 2)
    rows, columns = v / TEXEL_UM + r0, u / TEXEL_UM + c0
    fine, coarse, drops = (sampled(t, rows, columns) for t in shared[1:])
    plasm = (0.2 + 0.2 * ripe) * random.uniform(0.8, 1.25) * (1 + 0.5 * fine + 0.4 * coarse).clip(0.1)
    plasm *= 1 - (0.3 + 0.35 * ripe) * soft(drops - 0.35, 0.2)  # drops of fat and grains of starch stay pale
    if abs(lift) < 0.6:
        plasm = _contents(plasm, p, q, cut, ripe, (fine, coarse), random)
    gone = random.random() < 0.07  # an empty, barren grain
    if gone:
        plasm = plasm * 0.12
    net = _net(rows, columns, (v, u), cut, lift, shared)
    body = soft(inward - coat * furrow - 0.5, 1.2)
    inside = soft(inward, 0.9)
    top = abs(lift) > 0.72
    image = np.maximum(exine, body * (0.5 * plasm + (0.3 + 0.3 * ripe) * net if top else plasm))
    image = np.maximum(image, 0.06 * inside)
    shown = random.choice([1.0, 0.55], p=[0.8, 0.2])  # some lie mostly below
    part = upper[spans[0], spans[1]]
    part += inside * (shown * image + (1 - shown) * part - part)
    below = soft(inward + 1.5, 4.0)
    under = below * (0.10 + (1.25 - shown) * (0.1 * net + 0.22 * plasm + 0.25 * exine))
    np.maximum(lower[spans[0], spans[1]], under, out=lower[spans[0], spans[1]])


def _exine(
    inward: np.ndarray, arc: np.ndarray, coat: np.ndarray, shared: Textures, random: np.random.Generator
) -> np.ndarray:
    """The wall in cross section: a foot layer, rods with heads, gaps where the cut meets a mesh."""
    length = 2048
    beat = random.uniform(1.9, 2.5)
    wander = gaussian_filter1d(random.normal(0, 1, length), 3, mode="wrap")
    phase = np.cumsum(0.2 / beat * (1 + 0.8 * wander))
    rods = 0.5 + 0.5 * np.cos(2 * np.pi * phase)
    gaps = soft(gaussian_filter1d(random.normal(0, 1, length), 9, mode="wrap") / 0.13 + 0.75, 0.8)
    at = (arc / 0.2).astype(np.int32) % length
    rod, here = rods[at].astype(np.float32), gaps[at].astype(np.float32)
    level = inward / np.maximum(coat, 0.3)  # 0 on the outside, 1 at the foot
    sheath = soft(inward, 0.8) * soft(coat - inward, 0.8)
    heads = soft(0.45 - level, 0.25) * (0.35 + 0.65 * soft(rod - 0.25, 0.7))
    stems = soft(level - 0.3, 0.3) * (0.25 + 0.6 * soft(rod - 0.5, 0.6))
    foot = soft(level - 0.74, 0.2)
    return 0.95 * sheath * np.maximum(np.maximum(heads, stems) * (0.25 + 0.75 * here), 0.85 * foot)


def _net(
    rows: np.ndarray,
    columns: np.ndarray,
    place: tuple[np.ndarray, np.ndarray],
    cut: float,
    lift: float,
    shared: Textures,
) -> np.ndarray:
    """The net on the cap that is seen from above; towards the rim it is seen askew, and its meshes narrow."""
    slant = np.sqrt(1 - min(abs(lift), 0.97) ** 2)
    radius = cut / slant
    r = np.hypot(*place)
    away = np.arcsin(np.clip(r / radius, 0, 0.985)) * radius / np.maximum(r, 1e-3) - 1
    return sampled(shared.net, rows + place[0] / TEXEL_UM * away, columns + place[1] / TEXEL_UM * away)


def _contents(
    plasm: np.ndarray,
    p: np.ndarray,
    q: np.ndarray,
    cut: float,
    ripe: float,
    granules: tuple[np.ndarray, np.ndarray],
    random: np.random.Generator,
) -> np.ndarray:
    """Nucleus, and the vacuole of a microspore or the lens-shaped generative cell of pollen."""
    fine, coarse = granules
    way = random.uniform(0, 2 * np.pi)

    def disc(off: float, direction: float, size: float, flat: float = 1.0, tilt: float = 0.0) -> np.ndarray:
        x, y = p - off * np.cos(direction), q - off * np.sin(direction)
        c, s = np.cos(tilt), np.sin(tilt)
        along, across = c * x + s * y, c * y - s * x
        wobble = 1 + 0.08 * np.sin(3 * np.arctan2(across, along) + way)
        return (1 - np.hypot(along / size, across / (size * flat)) / wobble) * size * flat

    if ripe < 0.45 and random.random() < 0.75:
        hole = disc(random.uniform(0.1, 0.28) * cut, way + np.pi, random.uniform(0.4, 0.55) * cut, 0.85, way)
        pale = (0.8 + 0.2 * coarse).clip(0.5, 0.9)  # shreds of plasm cross it above and below
        plasm = plasm * (1 - pale * soft(hole, 1.6)) + 0.1 * np.exp(-((hole / 0.8) ** 2))
    off = random.uniform(0.15, 0.5) * cut
    size = random.uniform(0.2, 0.3) * cut
    if random.random() < 0.7:
        nucleus = disc(off, way, size, random.uniform(0.7, 1.0), way)
        tone = 0.38 + 0.14 * coarse + 0.1 * fine + 0.15 * np.exp(-(((nucleus - 0.4) / 0.7) ** 2))
        spot = disc(off + 0.3 * size, way, 0.33 * size)
        tone = np.maximum(tone, 0.95 * soft(spot, 0.9))
        inside = soft(nucleus, 1.0)
        plasm = plasm + inside * (tone - plasm)
    if ripe > 0.45 and random.random() < 0.65:
        direction = way + random.uniform(1.8, 4.5)
        tilt, where = random.uniform(0, np.pi), random.uniform(0.2, 0.45) * cut
        cell = disc(where, direction, 0.36 * cut, 0.45, tilt)
        core = disc(where, direction, 0.25 * cut, 0.42, tilt)
        plasm = plasm + soft(cell, 1.0) * (0.16 - plasm) + 0.14 * np.exp(-((cell / 0.6) ** 2))
        plasm = plasm + soft(core, 0.9) * (0.75 + 0.25 * coarse + 0.15 * fine - plasm)
    return plasm
