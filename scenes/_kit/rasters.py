"""Pictures of slides on a fine raster: smooth noise, points and strokes, cells and crystals that grow till they meet.

Pictures are float32 arrays (row, column), row 0 at the bottom; places and lengths on them are in texels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

Shape = tuple[int, int]
Window = tuple[slice, slice]

ELLIPSE, BOX, HEXAGON = range(3)


def noise(shape: Shape, cell: float | tuple[float, float], random: np.random.Generator) -> np.ndarray:
    """Smooth value noise in -1..1 on a lattice of so many texels (down and across)."""
    cells = cell if isinstance(cell, tuple) else (cell, cell)
    lattice = random.uniform(-1, 1, [int(n / c) + 2 for n, c in zip(shape, cells, strict=True)]).astype(np.float32)
    for axis in (0, 1):
        at = np.arange(shape[axis], dtype=np.float32) / np.float32(cells[axis])
        first = at.astype(np.int64)
        part = at - first
        part *= part * (3 - 2 * part)
        part = part[:, None] if axis == 0 else part
        here = np.take(lattice, first, axis=axis)
        lattice = here + part * (np.take(lattice, first + 1, axis=axis) - here)
    return lattice


def fractal(shape: Shape, cell: float, octaves: int, random: np.random.Generator) -> np.ndarray:
    """Octaves of noise, each twice as fine and 0.6 times as strong, about -1..1."""
    total = np.zeros(shape, dtype=np.float32)
    for k in range(octaves):
        total += np.float32(0.6**k) * noise(shape, max(cell / 2**k, 1.0), random)
    return total


def soft(distance: np.ndarray, width: float) -> np.ndarray:
    """0 below, 1 above a boundary, straight over so many units across it: an edge without steps."""
    return np.clip(distance / np.float32(width) + np.float32(0.5), 0, 1)


def sampled(picture: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """A picture at other places, linear between texels; it repeats beyond its rim."""
    height, width = picture.shape
    flat = np.ascontiguousarray(picture).ravel()
    low_r, low_c = np.floor(rows), np.floor(columns)
    r, c = (rows - low_r).astype(np.float32), (columns - low_c).astype(np.float32)
    r0, c0 = _wrapped(low_r.astype(np.int32), height), _wrapped(low_c.astype(np.int32), width)
    r1, c1 = r0 + 1, c0 + 1
    r1[r1 == height] = 0
    c1[c1 == width] = 0
    r0 *= width
    r1 *= width
    below = flat.take(r0 + c0)
    below += c * (flat.take(r0 + c1) - below)
    above = flat.take(r1 + c0)
    above += c * (flat.take(r1 + c1) - above)
    above -= below
    above *= r
    return below + above


def _wrapped(index: np.ndarray, size: int) -> np.ndarray:
    """Indices within 0..size-1; the division is slow and rarely needed."""
    return index if index.min(initial=0) >= 0 and index.max(initial=0) < size else index % size


def splat(shape: Shape, rows: np.ndarray, columns: np.ndarray, weight: Any, *, blur: float = 0.6) -> np.ndarray:
    """Points of a weight each, shared among four texels, then blurred by so many texels (standard deviation)."""
    weight = np.broadcast_to(np.asarray(weight, dtype=np.float64), rows.shape)
    low_r, low_c = np.floor(rows).astype(np.int64), np.floor(columns).astype(np.int64)
    r, c = rows - low_r, columns - low_c
    total = np.zeros(shape[0] * shape[1])
    for row, column, share in (
        (low_r, low_c, (1 - r) * (1 - c)),
        (low_r, low_c + 1, (1 - r) * c),
        (low_r + 1, low_c, r * (1 - c)),
        (low_r + 1, low_c + 1, r * c),
    ):
        inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
        at = (row * shape[1] + column)[inside]
        total += np.bincount(at, (weight * share)[inside], minlength=total.size)
    return gaussian_filter(total.reshape(shape).astype(np.float32), blur)


def strokes(
    starts: np.ndarray, angles: np.ndarray, lengths: np.ndarray, *, bend: np.ndarray | float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points along strokes, half a texel apart: rows, columns, and the number of each point's stroke.

    starts : (n, 2), row and column of each stroke's middle. bend : curvature of each, radians a texel.
    """
    counts = np.maximum((2 * lengths).astype(int), 1)
    which = np.repeat(np.arange(len(counts)), counts)
    step = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    along = 0.5 * step - lengths[which] / 2
    aside = 0.5 * np.broadcast_to(np.asarray(bend), counts.shape)[which] * along**2
    c, s = np.cos(angles)[which], np.sin(angles)[which]
    return starts[which, 0] + s * along + c * aside, starts[which, 1] + c * along - s * aside, which


def window(shape: Shape, at: tuple[float, float], reach: float) -> Window | None:
    """The part of a picture within reach of a place (row, column); None for no texel."""
    spans = []
    for middle, n in zip(at, shape, strict=True):
        low, high = max(int(middle - reach), 0), min(int(middle + reach) + 2, n)
        if high <= low:
            return None
        spans.append(slice(low, high))
    return spans[0], spans[1]


@dataclass(frozen=True)
class Seeds:
    """What grows, (n,) each.

    row, column : where. angle : direction of the length, radians. long, wide : half length and half width that are
    added in a unit of time. start, until : times between which it grows. form : ELLIPSE, BOX or HEXAGON. bent : how
    much of ``bend`` applies, 0..1.
    """

    row: np.ndarray
    column: np.ndarray
    angle: np.ndarray
    long: np.ndarray
    wide: np.ndarray
    start: np.ndarray
    until: np.ndarray
    form: np.ndarray
    bent: np.ndarray


@dataclass(frozen=True)
class Growth:
    """Who reached each texel first: an anisotropic, weighted Voronoi diagram.

    first, second, third : time of the three earliest arrivals. owner, other : who came first and second, -1 for
    nobody. edge : about the distance from the boundary between them, or from where growth ended, in texels. speed :
    texels per unit of time at which the first one grew there.
    """

    first: np.ndarray
    second: np.ndarray
    third: np.ndarray
    owner: np.ndarray
    other: np.ndarray
    edge: np.ndarray
    speed: np.ndarray


def grow(shape: Shape, seeds: Seeds, *, bend: tuple[np.ndarray, np.ndarray]) -> Growth:
    """Let crystals or cells grow from seeds, each in its form, until they meet.

    bend : by how much places are moved up and across before they are compared, which makes straight boundaries curved.
    """
    first, second, third = (np.full(shape, 1e3, np.float32) for _ in range(3))
    speed_1, speed_2 = np.ones(shape, np.float32), np.ones(shape, np.float32)
    owner, other = (np.full(shape, -1, np.int32) for _ in range(2))
    slack = max(float(np.abs(field).max()) for field in bend)
    for k in range(len(seeds.row)):
        a, b, start = np.float32(seeds.long[k]), np.float32(seeds.wide[k]), np.float32(seeds.start[k])
        bent = np.float32(seeds.bent[k])
        reach = max(a, b) * max(seeds.until[k] - start, 0.0) + bent * slack
        here = window(shape, (seeds.row[k], seeds.column[k]), reach)
        if here is None:
            continue
        v, u = np.ogrid[here]
        v = (v - np.float32(seeds.row[k])).astype(np.float32) + bent * bend[0][here]
        u = (u - np.float32(seeds.column[k])).astype(np.float32) + bent * bend[1][here]
        c, s = np.float32(np.cos(seeds.angle[k])), np.float32(np.sin(seeds.angle[k]))
        p, q = (c * u + s * v) / a, (c * v - s * u) / b
        time, speed = _arrival(p, q, float(a), float(b), int(seeds.form[k]))
        time += start
        time[time > seeds.until[k]] = np.inf
        f1, f2, f3, s1, s2, o1, o2 = (grid[here] for grid in (first, second, third, speed_1, speed_2, owner, other))
        won = time < f1
        runner = ~won & (time < f2)
        np.copyto(f3, np.where(won | runner, f2, np.minimum(f3, time)))
        np.copyto(f2, np.where(won, f1, time), where=won | runner)
        np.copyto(s2, np.where(won, s1, speed), where=won | runner)
        np.copyto(o2, np.where(won, o1, k), where=won | runner)
        np.copyto(f1, time, where=won)
        np.copyto(s1, speed, where=won)
        np.copyto(o1, k, where=won)
    edge = (second - first) / (1 / speed_1 + 1 / speed_2)
    edge = np.minimum(edge, (np.asarray(seeds.until, dtype=np.float32)[owner] - first) * speed_1)
    return Growth(first, second, third, owner, other, edge, speed_1)


def _arrival(p: np.ndarray, q: np.ndarray, a: float, b: float, form: int) -> tuple[np.ndarray, np.ndarray]:
    """Time of arrival at places in units of the half sizes, and the speed there (texels per unit)."""
    if form == ELLIPSE:
        time = np.sqrt(p * p + q * q)
        return time, time / np.maximum(np.sqrt((p / a) ** 2 + (q / b) ** 2), np.float32(1e-6))
    p, q = np.abs(p), np.abs(q)
    if form == BOX:
        return np.maximum(p, q), np.where(p > q, np.float32(a), np.float32(b))
    slanted = np.float32(0.75) * p + np.float32(0.62) * q
    return np.maximum(np.maximum(p * np.float32(0.86), q), slanted), np.full_like(p, min(a, b))
