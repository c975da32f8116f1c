"""Photographs that the newspaper prints, as tones in 0..1, row 0 on top: distance fields, lit by a sun.

Rays are marched by the distance to the nearest surface (Hart 1996, doi:10.1007/s003710050084).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from surfaces import cloudy, noise

Field = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
STEPS, FAR, NEAR = 72, 400.0, 0.004
HAZE = {"lighthouse": 260.0, "steamer": 320.0, "balloons": 170.0, "bridge": 150.0}  # m for a share of 1/e
VIEWS = {  # camera, what it looks at, height of the picture over its distance
    "lighthouse": ((26, 5.0, 34), (2.0, 8.2, 0), 0.62),
    "steamer": ((44, 7.0, 74), (1.0, 8.0, 0), 0.56),
    "balloons": ((0, 22.0, 60), (0, 24.0, 0), 0.62),
    "bridge": ((34, 9.0, 62), (-6, 14.0, -20), 0.66),
}


def photograph(motif: str, shape: tuple[int, int], random: np.random.Generator) -> np.ndarray:
    """Tones of a photograph (rows, columns): lighthouse, steamer, balloons or bridge."""
    origin, towards, height = VIEWS[motif]
    field = {"lighthouse": _lighthouse, "steamer": _steamer, "balloons": _balloons, "bridge": _bridge}[motif]
    side = float(random.choice([-1, 1]))
    sun = np.array([side * random.uniform(0.4, 0.8), random.uniform(0.4, 0.7), random.uniform(0.3, 0.7)])
    sun /= np.linalg.norm(sun)
    start, rays = _rays(np.array(origin, dtype=np.float32), np.array(towards, dtype=np.float32), height, shape)
    clouds = np.clip(0.5 + 0.9 * cloudy((400, 1200), 14, 6, random), 0, 1)

    def sky(way: np.ndarray) -> np.ndarray:
        up = np.clip(way[:, 1], 0.0, 1)
        row = np.clip(399 - 600 * up, 0, 399).astype(int)
        column = np.mod(600 + 420 * np.arctan2(way[:, 0], -way[:, 2]), 1200).astype(int)
        return 0.82 - 0.45 * up + 0.26 * (clouds[row, column] - 0.45) * np.clip(up * 9, 0.25, 1)

    way = rays.reshape(-1, 3)
    seen, where = _march(field, np.broadcast_to(start, way.shape), way)
    tone = sky(way)
    tone[where] = _shaded(field, seen[where], sun, hidden=True)
    far = np.linalg.norm(seen - start, axis=1)
    if motif != "balloons":
        tone = _sea(field, start, way, tone, np.where(where, far, np.inf), sky, sun, random)
        level = way[:, 1] < -1e-4
        far = np.where(level & ~where, -start[1] / np.where(level, way[:, 1], -1), far)
        where = where | level
    veil = np.exp(-np.minimum(far, 1e4) / HAZE[motif])
    tone = np.where(where, veil * tone + (1 - veil) * 0.78, tone).reshape(shape)
    if motif == "steamer":
        tone = _smoke(tone, random)
    tone = tone + 0.035 * noise(shape, (shape[0] / 1.5, shape[1] / 1.5), random)  # grain of the plate
    low, high = np.quantile(tone, [0.01, 0.985])
    tone = np.clip((tone - low) / (high - low), 0, 1)
    y, x = (np.linspace(-1, 1, n) for n in shape)
    tone *= 1 - 0.16 * (x[None, :] ** 2 + y[:, None] ** 2) / 2  # the corners are darker
    return (0.04 + 0.92 * tone**0.9).astype(np.float32)


def _rays(
    origin: np.ndarray, towards: np.ndarray, height: float, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    axis = (towards - origin) / np.linalg.norm(towards - origin)
    right = np.cross(axis, [0, 1, 0])
    right /= np.linalg.norm(right)
    up = np.cross(right, axis)
    rows, columns = shape
    y = (0.5 - (np.arange(rows) + 0.5) / rows) * height
    x = ((np.arange(columns) + 0.5) / columns - 0.5) * height * columns / rows
    way = axis + x[None, :, None] * right + y[:, None, None] * up
    return origin, (way / np.linalg.norm(way, axis=2, keepdims=True)).astype(np.float32)


def _march(field: Field, start: np.ndarray, way: np.ndarray, steps: int = STEPS) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) where rays end, and which of them meet a surface."""
    far = np.full(len(way), 0.05, dtype=np.float32)
    met = np.zeros(len(way), dtype=bool)
    going = np.arange(len(way))
    for _ in range(steps):
        distance, _ = field(start[going] + far[going, None] * way[going])
        close = distance < NEAR + 4e-4 * far[going]
        met[going[close]] = True
        far[going] += np.where(close, 0, 0.85 * distance)
        going = going[~close & (far[going] < FAR)]
        if not going.size:
            break
    met[going] = True  # they graze a surface
    return start + far[:, None] * way, met


def _shaded(field: Field, points: np.ndarray, sun: np.ndarray, *, hidden: bool) -> np.ndarray:
    """Light of a sun, with its shadows if ``hidden``, and of a sky, from matt surfaces."""
    step = 0.02
    normal = np.zeros_like(points)
    for corner in ((1, -1, -1), (-1, -1, 1), (-1, 1, -1), (1, 1, 1)):
        normal += np.array(corner) * field(points + step * np.array(corner))[0][:, None]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-9
    direct = np.clip(normal @ sun, 0, 1)
    if hidden:
        away = points + 0.06 * normal
        _, met = _march(field, away, np.broadcast_to(sun.astype(np.float32), points.shape), 28)
        direct = np.where(met, 0, direct)
    open_ = np.clip(field(points + 1.2 * normal)[0] / 1.2, 0.25, 1)
    return field(points)[1] * (0.95 * direct + 0.42 * open_ * (0.6 + 0.4 * normal[:, 1]))


def _sea(
    field: Field,
    start: np.ndarray,
    way: np.ndarray,
    tone: np.ndarray,
    far: np.ndarray,
    sky: Callable[[np.ndarray], np.ndarray],
    sun: np.ndarray,
    random: np.random.Generator,
) -> np.ndarray:
    """Water at height 0 in place of what is beyond it: it mirrors the sky and what stands in it."""
    down = way[:, 1] < -1e-4
    reach = np.where(down, -start[1] / np.where(down, way[:, 1], -1), np.inf)
    wet = np.flatnonzero(reach < far)
    ray = way[wet]
    point = start + reach[wet, None] * ray
    slope = np.zeros((len(wet), 2))
    for wave in (0.5, 1.1, 2.3, 4.7):
        for _ in range(3):
            turn, phase = random.uniform(0, 2 * np.pi, 2)
            across = np.array([np.cos(turn), np.sin(turn)])
            calm = np.exp(-reach[wet] * wave / 90)  # finer waves are lost with the distance
            slope += np.outer(0.035 * calm * np.cos(wave * (point[:, [0, 2]] @ across) + phase), across)
    normal = np.stack([slope[:, 0], np.ones(len(wet)), slope[:, 1]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    facing = np.clip(-(ray * normal).sum(1), 0, 1)
    mirror = ray + 2 * facing[:, None] * normal
    mirror[:, 1] = np.abs(mirror[:, 1])
    light = sky(mirror)
    seen, met = _march(field, point.astype(np.float32), mirror.astype(np.float32), 30)
    light[met] = _shaded(field, seen[met], sun, hidden=False)
    share = 0.03 + 0.97 * (1 - facing) ** 4
    glitter = 0.5 * np.clip(mirror @ sun, 0, 1) ** 90
    tone[wet] = share * light + (1 - share) * 0.13 + glitter
    return tone


def _box(p: np.ndarray, middle: tuple[float, float, float], half: tuple[float, float, float]) -> np.ndarray:
    q = np.abs(p - np.array(middle, dtype=np.float32)) - np.array(half, dtype=np.float32)
    return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)


def _drum(p: np.ndarray, at: tuple[float, float], span: tuple[float, float], radius: float | np.ndarray) -> np.ndarray:
    """An upright cylinder about (x, z) from one height to another."""
    off = np.hypot(p[:, 0] - at[0], p[:, 2] - at[1]) - radius
    high = np.abs(p[:, 1] - (span[0] + span[1]) / 2) - (span[1] - span[0]) / 2
    return np.maximum(off, high)


def _nearest(*parts: tuple[np.ndarray, np.ndarray | float]) -> tuple[np.ndarray, np.ndarray]:
    distance, tone = (parts[0][0], np.broadcast_to(np.asarray(parts[0][1], dtype=np.float32), parts[0][0].shape))
    for d, a in parts[1:]:
        tone = np.where(d < distance, a, tone)
        distance = np.minimum(d, distance)
    return distance, tone


def _rough(p: np.ndarray, scale: float) -> np.ndarray:
    """A lumpy function of space in about -1..1, of four octaves."""
    total = np.zeros(len(p), dtype=np.float32)
    for k in range(4):
        q = p * np.float32(scale * 1.9**k)
        x, y, z = q[:, 0], q[:, 1], q[:, 2]
        total += (
            np.float32(0.55**k) * np.sin(x + 1.7 * np.sin(z + k)) * np.sin(1.3 * y + x) * np.sin(z + 0.8 * y + 2 * k)
        )
    return total


def _lighthouse(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y, z = p[:, 0], p[:, 1], p[:, 2]
    rock = (np.sqrt((x / 13) ** 2 + ((y + 1.5) / 5.2) ** 2 + (z / 9) ** 2) - 1) * 4.6 + 0.8 * _rough(p, 0.45)
    tower = _drum(p, (0, 0), (2, 16), 2.5 - 0.065 * y)
    bands = np.where(np.mod(y, 6.4) < 3.2, 0.9, 0.2)
    window = (np.abs(x - 1.0) < 0.3) & (np.mod(y - 1.2, 4.5) < 0.9)
    gallery = np.minimum(_drum(p, (0, 0), (15.6, 16.0), 2.3), np.abs(_drum(p, (0, 0), (16.8, 16.9), 2.2)) + 0.02)
    roof = np.sqrt(x * x + ((y - 18.6) * 0.9) ** 2 + z * z) - 1.35
    house = _box(p, (6.6, 3.9, 1.0), (2.5, 1.5, 1.7))
    gable = np.maximum(np.abs(z - 1.0) * 0.75 + (y - 5.2) * 0.66 - 1.35, np.maximum(np.abs(x - 6.6) - 2.7, 5.2 - y))
    panes = (np.mod(x - 4.9, 1.7) < 0.55) & (np.abs(y - 4.2) < 0.55)
    return _nearest(
        (0.6 * rock, 0.28 + 0.10 * _rough(p, 1.3)),
        (0.9 * tower, np.where(window, 0.06, bands)),
        (gallery, 0.16),
        (_drum(p, (0, 0), (16, 18.4), 1.25), np.where(np.mod(np.arctan2(x, z) * 2.5, 1) < 0.2, 0.08, 0.55)),
        (roof, 0.10),
        (house, np.where(panes, 0.06, 0.82)),
        (0.8 * gable, 0.16),
    )


def _steamer(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y, z = p[:, 0], p[:, 1], p[:, 2]
    sheer = 4.2 + 0.0016 * x * x
    beam = 4.6 * np.sqrt(np.clip(1 - (np.abs(x) / 36) ** 2.6, 0.0004, 1)) * (0.72 + 0.28 * np.clip(y / 4, 0, 1))
    hull = np.maximum(np.maximum(np.abs(z) - beam, y - sheer), np.maximum(np.abs(x) - 35.5, -1 - y)) * 0.7
    ports = (np.mod(x, 1.6) < 0.5) & (np.abs(y - 2.9) < 0.26) & (np.abs(x) < 30)
    paint = np.where(y < 0.8, 0.2, np.where(ports, 0.5, 0.07))
    decks = [
        _box(p, (0, 5.5, 0), (21, 1.3, 3.7)),
        _box(p, (1, 7.9, 0), (16, 1.1, 3.1)),
        _box(p, (13, 9.9, 0), (2.4, 1.1, 2.8)),
    ]
    shade = np.where((np.mod(x, 1.25) < 0.62) & (np.mod(y - 4.9, 2.4) < 1.0), 0.16, 0.88)
    raked = p - np.array([-0.10, 0, 0], dtype=np.float32) * (y - 9)[:, None]
    funnels = [_drum(raked, (at, 0), (8.5, 17.5), 1.35) for at in (-8.5, -1.5, 5.5)]
    masts = [_drum(raked, (at, 0), (4, 23), 0.17) for at in (-26, 26)]
    boats = [
        np.sqrt(((x - at) / 2.1) ** 2 + ((y - 9.7) / 0.7) ** 2 + ((z - 3.1) / 0.8) ** 2) - 1 for at in (-11, -5, 1, 7)
    ]
    return _nearest(
        (hull, paint),
        *((deck, shade) for deck in decks),
        *((funnel, np.where(y > 15.6, 0.05, np.where(y > 14.2, 0.75, 0.34))) for funnel in funnels),
        *((mast, 0.25) for mast in masts),
        *((0.65 * boat, 0.9) for boat in boats),
    )


def _balloons(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y, z = p[:, 0], p[:, 1], p[:, 2]
    hills = (
        4 * np.sin(0.05 * x + 0.6) * np.sin(0.043 * z)
        + 2.2 * np.sin(0.11 * x + 0.09 * z)
        + 7 * np.exp(-(((z + 190) / 70) ** 2))
    )
    trees = 1.1 * np.clip(_rough(p * np.array([1, 0.2, 1], dtype=np.float32), 0.42), 0, 1)
    fields = 0.34 + 0.18 * np.sign(np.sin(0.16 * x + 0.05 * z) * np.sin(0.11 * z + 0.03 * x)) - 0.22 * (trees > 0.12)
    parts = [(0.55 * (y - hills - trees), fields)]
    for at, r, dark in (((-11, 25, 10), 6.2, 0.15), ((10, 30, -18), 6.0, 0.42), ((19, 21, -66), 6.5, 0.25)):
        q = p - np.array(at, dtype=np.float32)
        ball = np.linalg.norm(q * np.array([1, 0.94, 1], dtype=np.float32), axis=1) - r
        out = np.hypot(q[:, 0], q[:, 2])
        cone = np.maximum(
            0.62 * out * 1.25 - 0.5 * (q[:, 1] + 1.72 * r), np.maximum(q[:, 1] + 0.45 * r, -1.5 * r - q[:, 1])
        )
        gores = np.where(np.mod(np.arctan2(q[:, 0], q[:, 2]) * 16 / (2 * np.pi), 2) < 1, 0.88, dark)
        gores = np.where(np.abs(q[:, 1]) < 0.10 * r, 0.12, gores)
        ropes = (
            np.abs(out - (0.10 * r + 0.16 * (q[:, 1] + 2.25 * r)))
            + np.abs(np.mod(np.arctan2(q[:, 0], q[:, 2]) * 4 / np.pi, 1) - 0.5) * out * 0.6
        )
        ropes = np.maximum(ropes - 0.05, np.abs(q[:, 1] + 1.85 * r) - 0.4 * r)
        basket = _box(q, (0, -2.35 * r, 0), (0.16 * r, 0.14 * r, 0.16 * r))
        parts += [(ball, gores), (0.8 * cone, gores), (0.7 * ropes, 0.1), (basket, 0.12)]
    return _nearest(*parts)


def _bridge(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y, z = p[:, 0], p[:, 1], p[:, 2]
    side = np.abs(z + 20) - 3.2
    along = np.mod(x + 45, 90) - 45  # a tower at every 90 m, the middle of a span between
    legs = np.maximum(np.maximum(np.abs(along) - 1.5 + 0.018 * y, np.abs(side) - 1.1), y - 34)
    cross = [_box(np.stack([along, y, side + 3.2], 1), (0, at, 0), (1.0, 0.8, 3.3)) for at in (13.5, 24, 32)]
    foot = np.maximum(np.maximum(np.abs(along) - 4.2, np.abs(z + 20) - 6.5), y - 2.4)
    deck = np.maximum(np.abs(y - 10.6) - 0.75, np.abs(z + 20) - 4.2)
    truss = np.maximum(np.abs(side) - 0.25, np.abs(y - 10.4) - 1.6)
    open_ = (np.abs(np.mod(x, 3.0) - 1.5) > 0.2) & (np.abs(np.abs(y - 10.4) - 1.45) > 0.2)
    sag = 11.8 + 21.6 * (np.abs(np.abs(along) - 45) / 45) ** 2
    chain = np.hypot(0.72 * (y - sag), side) - 0.34
    hang = np.maximum(np.hypot(np.mod(x, 3.0) - 1.5, side) - 0.09, np.maximum(y - sag, 10 - y))
    hills = y - 15 * np.exp(-(((z + 330) / 90) ** 2)) * (0.7 + 0.3 * np.sin(0.021 * x) + 0.12 * np.sin(0.07 * x))
    return _nearest(
        (legs, 0.30), *((piece, 0.28) for piece in cross), (foot, 0.42), (deck, 0.22),
        (truss, np.where(open_, 0.42, 0.12)), (chain, 0.10), (hang, 0.10), (0.5 * hills, 0.25),
    )  # fmt: skip


def _smoke(tone: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A plume from each funnel, which widens and thins downwind."""
    rows, columns = tone.shape
    y, x = np.mgrid[0:rows, 0:columns] / rows
    billows = cloudy(tone.shape, 16, 5, random)
    side = float(random.choice([-1, 1]))
    for at in (-0.23, -0.02, 0.17):
        away = side * (x - columns / rows / 2 - at)
        middle = 0.335 - 0.20 * np.sqrt(np.clip(away, 0, None)) + 0.03 * billows
        half = 0.016 + 0.11 * np.clip(away, 0, None)
        dense = np.clip(1.25 - np.abs(y - middle) / half + 0.8 * billows, 0, 1) * np.exp(-1.1 * np.clip(away, 0, None))
        dense *= away > -0.012
        tone = tone + 0.85 * dense * (0.24 + 0.22 * np.clip(billows, -0.5, 1) - tone)
    return tone
