"""The skins of cars: paint with dirt, windows, lamps, gaps, handles, number plates, as reflectances."""

from __future__ import annotations

import numpy as np
from cars import HEIGHT_M, TEXEL_M, Kind, side_rows, wide_rows
from meshes import Body
from surfaces import noise


def paint_shop(skins: list[np.ndarray], shells: list[Body]) -> tuple[np.ndarray, list[Body]]:
    """All skins in one picture, and the shells with texture coordinates 0..1 in it."""
    high, wide = sum(len(s) for s in skins), max(s.shape[1] for s in skins)
    picture = np.zeros((high, wide), dtype=np.float32)
    first, laid = 0, []
    for painted, made in zip(skins, shells, strict=True):
        picture[first : first + len(painted), : painted.shape[1]] = painted
        uv = np.stack([made.uv[:, 0] / wide, 1 - (made.uv[:, 1] + first) / high], axis=1)
        laid.append(Body(made.vertices, made.triangles, uv, made.tone))
        first += len(painted)
    return picture, laid


def skin(kind: Kind, paint: float, random: np.random.Generator) -> np.ndarray:
    """The picture on a :func:`shell`: paint with dirt, windows, lamps, gaps, handles, plates."""
    side, wide, columns = side_rows(), wide_rows(kind), int(kind.length / TEXEL_M)
    x = (np.arange(columns) + 0.5) / columns * kind.length - kind.length / 2
    y = HEIGHT_M - (np.arange(side) + 0.5) * TEXEL_M
    z = (np.arange(wide) + 0.5) / wide * kind.width - kind.width / 2
    ends = np.full((wide, columns), paint, dtype=np.float32)
    tall = HEIGHT_M * (1 - (np.arange(wide) + 0.5) / wide)[:, None]
    shift = int(0.5 * columns)
    _end(ends[:, :wide], z[None, :], tall, kind, random, front=True)
    _end(ends[:, shift : shift + wide], z[None, :], tall, kind, random, front=False)
    views = [_side(x[None, :], y[:, None], kind, paint, random), _top(x[None, :], z[:, None], kind, paint), ends]
    picture = np.concatenate(views)
    dust = noise(picture.shape, (picture.shape[0] // 12, columns // 20), random)
    return np.clip(picture * (1 + 0.07 * dust) + 0.012 * np.abs(dust), 0.015, 0.85).astype(np.float32)


def _side(x: np.ndarray, y: np.ndarray, kind: Kind, paint: float, random: np.random.Generator) -> np.ndarray:
    picture = np.full(np.broadcast_shapes(x.shape, y.shape), paint, dtype=np.float32)
    top = np.interp(x, *np.array(kind.roof).T)
    rear, front, rear_top, front_top = kind.glass
    rise = np.clip((y - kind.belt) / (kind.top - kind.belt), 0, 1)
    behind, ahead = rear + rise * (rear_top - rear) + 0.16, front + rise * (front_top - front) - 0.14
    pane = (y > kind.belt + 0.02) & (y < top - 0.10) & (x > behind) & (x < ahead)
    seal = (y > kind.belt - 0.01) & (y < top - 0.07) & (x > behind - 0.04) & (x < ahead + 0.04)
    if kind.top > 1.8:  # a panel van has windows in the cab only
        pane, seal = pane & (x > kind.pillars[0]), seal & (x > kind.pillars[0] - 0.04)
    picture[seal] = 0.02
    picture[pane] = 0.028
    for seat in (-0.35, 0.45):  # seats and heads, dim behind the glass
        head = np.hypot((x - seat - random.uniform(-0.1, 0.1)) / 0.13, (y - kind.belt - 0.16) / 0.17) < 1
        picture[head & pane] = 0.075
    for post in kind.pillars:
        picture[(np.abs(x - post) < 0.045) & seal] = 0.02
        picture[(np.abs(x - post) < 0.012) & (y < kind.belt) & (y > 0.30)] = 0.25 * paint
        handle = (x > post + 0.08) & (x < post + 0.26) & (np.abs(y - kind.belt + 0.13) < 0.022)
        picture[handle] = 0.05 if paint > 0.2 else 0.35
    gap = (np.abs(x - front + 0.12) < 0.012) & (y < kind.belt) & (y > 0.30)
    picture[gap] = 0.25 * paint
    crease = np.abs(y - kind.belt + 0.24 - 0.02 * x) < 0.015
    picture[crease & ~pane & ~seal] *= 0.72
    half = kind.length / 2
    picture[(x > half - 0.38) & (np.abs(y - 0.68 - 0.10 * (x - half)) < 0.075)] = 0.72
    picture[(x < -half + 0.24) & (np.abs(y - 0.86) < 0.13)] = 0.13
    picture[np.broadcast_to(y < 0.29, picture.shape)] = 0.05
    dirt = np.clip((0.62 - y) / 0.4, 0, 1) * 0.35
    picture += dirt * (0.16 - picture)
    for axle in kind.axles:
        picture[np.hypot(x - axle, y - kind.wheel) < kind.wheel + 0.055] = 0.012
    return picture


def _top(x: np.ndarray, z: np.ndarray, kind: Kind, paint: float) -> np.ndarray:
    picture = np.full(np.broadcast_shapes(x.shape, z.shape), paint, dtype=np.float32)
    rear, front, rear_top, front_top = kind.glass
    w = kind.width / 2
    for foot, head in ((front, front_top), (rear, rear_top)):
        rise = np.clip((x - foot) / (head - foot), 0, 1)
        inside = (x > min(foot, head)) & (x < max(foot, head)) & (np.abs(z) < w * (0.90 - 0.16 * rise) - 0.05)
        picture[inside] = 0.03
        picture[inside & (np.abs(rise - 0.05) < 0.03)] = 0.015
    picture[(np.abs(x - front - 0.03) < 0.02) | (np.abs(np.abs(z) - 0.80 * w) < 0.008) & (x > front)] = 0.03
    if kind.top > 1.8:
        return picture
    rail = (np.abs(np.abs(z) - 0.68 * w) < 0.015) & (x > rear_top) & (x < front_top)
    picture[rail] = 0.04
    return picture


def _end(
    picture: np.ndarray, z: np.ndarray, y: np.ndarray, kind: Kind, random: np.random.Generator, *, front: bool
) -> None:
    """Nose or tail, in place: lamps, grille or window, number plate."""
    w, aside = kind.width / 2, np.abs(z)
    half = kind.length / 2
    if front:
        low = np.interp(half - 0.06, *np.array(kind.roof).T) - 0.06  # middle of grille and lamps
        grille = (aside < 0.56 * w) & (np.abs(y - low) < 0.07)
        picture[grille] = 0.02
        picture[grille & (np.abs((y / 0.05) % 1 - 0.5) < 0.2)] = 0.30
        picture[(aside > 0.62 * w) & (aside < 0.99 * w) & (np.abs(y - low) < 0.08)] = 0.78
        picture[(aside < 0.52 * w) & (y < 0.38) & (y > 0.30)] = 0.02
        plate = 0.48
    else:
        pane = (aside < 0.80 * w) & (y > kind.belt + 0.10) & (y < kind.top - 0.13)
        if kind.top < 1.8:
            picture[pane] = 0.03
        picture[(aside > 0.70 * w) & (np.abs(y - 0.86) < 0.13)] = 0.13
        picture[(aside > 0.84 * w) & (np.abs(y - 0.80) < 0.05)] = 0.60
        plate = 0.66
    picture[(aside < 0.27) & (np.abs(y - plate) < 0.065)] = 0.70
    for k in range(7):
        glyph = (z > -0.23 + 0.066 * k) & (z < -0.185 + 0.066 * k) & (np.abs(y - plate) < 0.04)
        if k != 2:
            picture[glyph & (random.random(picture.shape) < 0.75)] = 0.03
    picture[np.broadcast_to(y < 0.27, picture.shape)] = 0.05
