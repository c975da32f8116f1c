"""The signpost: weathered boards with routed letters, bolts, a post of bark, snow on them; metres."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from clay import Clay
from solid_noise import solid_noise
from solids import Body, ball, grid, joined
from surfaces import cloudy, noise
from typeface import Typeface, ink

BOARD_M, TIP_M, THICK_M, TEXEL_M = (0.62, 0.15), 0.085, 0.028, 0.0006  # a pixel sees 2.4 mm to 3.1 mm
PICTURE_M = (BOARD_M[0] + 2 * TIP_M, BOARD_M[1])
POST_M, SNOW = 0.047, 0.83
PLACES = (
    "Grossalm",
    "Seehaus",
    "St. Veit",
    "Old Mill",
    "North Ridge",
    "Tarn",
    "Birkenhof",
    "Pass",
    "Almsee",
    "Hochwald",
)


def board(way: int, random: np.random.Generator) -> tuple[Body, Body]:
    """The front of a board that points to the left (-1) or right (1), and its edge, about the origin."""
    wide, high = BOARD_M
    u, v = np.meshgrid(np.linspace(0, 1, 80), np.linspace(-1, 1, 24), indexing="xy")
    end = wide / 2 + TIP_M * (1 - np.abs(v))
    x = way * (-wide / 2 + u * (wide / 2 + end))
    rim = np.minimum.reduce([u * 0.7, 1 - u, (1 - np.abs(v)) * 0.12]) / 0.012
    flat = np.stack([x, v * high / 2, np.zeros_like(x)], axis=2)
    warp = 0.0025 * solid_noise(flat.reshape(-1, 3), 0.25, random).reshape(x.shape)
    flat[..., 2] = warp - 0.004 * np.clip(1 - rim, 0, 1) ** 2
    uv = np.stack([0.5 + x / PICTURE_M[0], 0.5 + v / 2], axis=2)
    front = grid(flat if way > 0 else flat[:, ::-1], uv=uv if way > 0 else uv[:, ::-1])
    edge = np.concatenate([flat[0], flat[1:, -1], flat[-1, -2::-1], flat[-2::-1, 0]])
    back = edge - [0, 0, THICK_M]
    sides = grid(np.stack([edge, back]), tone=0.16)
    bolts = [
        ball((way * at, y, 0.002), (0.007, 0.007, 0.005), rings=8, around=12, tone=0.10)
        for at in (-0.03, 0.03)
        for y in (0.0,)
    ]
    return front, joined([sides, *bolts])


def face(way: int, name: str, dark: bool, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Reflectance and height (m) of a board's front, row 0 on top."""
    columns, rows = (round(side / TEXEL_M) for side in PICTURE_M)
    shape = rows, columns
    y = (np.arange(rows) + 0.5)[:, None] * TEXEL_M
    bend = cloudy(shape, 3, 2, random)
    knots = [(random.uniform(0.1, 0.9) * PICTURE_M[0], random.uniform(0, 1) * PICTURE_M[1]) for _ in range(3)]
    x = (np.arange(columns) + 0.5)[None, :] * TEXEL_M
    at = y / 0.011 + 0.7 * bend
    for kx, ky in knots:
        r = np.hypot((x - kx) / 2.6, y - ky) / 0.012
        at = at + 2.2 * np.sign(y - ky) * np.exp(-r)
    ring = at - np.floor(at)
    fibre = noise(shape, (rows / 2, columns / 60), random)
    tone = 0.10 if dark else 0.30
    grey = tone * (1.15 - 0.45 * ring**2 + 0.20 * fibre + 0.12 * cloudy(shape, 10, 4, random))
    high = -0.0012 * ring**2 + 0.0006 * fibre
    for kx, ky in knots:
        r = np.hypot((x - kx) / 1.3, y - ky) / 0.007
        grey = np.where(r < 1, grey * 0.55, grey)
    checks = (np.abs(noise(shape, (34, 4), random)) < 0.05) & (noise(shape, (9, 7), random) > 0.25)
    grey = np.where(checks, 0.25 * grey, grey)
    high = high - 0.003 * checks
    lettering = Typeface(Path(__file__).parent / "sign_bold.npz")
    words = f"{name}  {random.integers(1, 9)}.{random.integers(1, 9)} km"
    size = min(0.094, 0.50 / lettering.width(words, size=1.0))
    middle = (PICTURE_M[0] / 2 + way * 0.012, PICTURE_M[1] / 2 + 0.5 * lettering.cap_height * size)
    routed = ink(lettering.line(words, middle, size=size, align="centre"), shape, scale=1 / TEXEL_M)
    worn = np.clip(1.15 + 0.75 * cloudy(shape, 40, 3, random) + 0.25 * fibre, 0.1, 1)
    grey = grey + routed * worn * ((0.66 if dark else 0.035) - grey)
    high = high - 0.003 * routed
    run = np.clip(1.4 * noise(shape, (3, columns / 14), random) - 0.4, 0, 1) * np.clip(1 - y / PICTURE_M[1], 0, 1)
    grey = grey * (1 - 0.35 * run)
    low = np.clip((y / PICTURE_M[1] - 0.86) / 0.14, 0, 1)
    rime = cloudy(shape, 60, 4, random) + 1.2 * low + 0.9 * np.clip(1 - y / 0.012, 0, 1) > 1.12
    rime |= noise(shape, (rows / 5, columns / 5), random) > 0.955
    grey = np.where(rime, 0.78, grey)
    high = high + 0.002 * rime
    return np.clip(grey, 0.02, 0.85), high


def post(top: float, random: np.random.Generator) -> Body:
    """A stem with its bark, cut off at a height; v runs up, u round it."""
    around, rings = 180, 420
    angle, y = np.meshgrid(np.linspace(0, 2 * np.pi, around + 1), np.linspace(-0.6, top, rings), indexing="xy")
    unit = np.stack([np.sin(angle), y / POST_M, np.cos(angle)], axis=2)
    at = (unit * [POST_M, POST_M, POST_M]).reshape(-1, 3)
    plates = np.abs(solid_noise(at, (0.016, 0.06, 0.016), random, octaves=3)).reshape(angle.shape)
    fine = solid_noise(at, (0.004, 0.010, 0.004), random, octaves=2).reshape(angle.shape)
    deep = np.clip(1 - plates / 0.22, 0, 1)
    radius = POST_M * (1 + 0.04 * fine - 0.10 * deep + 0.03 * np.sin(5 * y))
    points = np.stack([radius * np.sin(angle), y, radius * np.cos(angle)], axis=2)
    tone = 0.19 * (1 + 0.45 * fine) * (1 - 0.7 * deep)
    blown = np.clip(
        0.9 * np.cos(angle - 2.2) + 0.7 * solid_noise(at, 0.02, random, octaves=3).reshape(angle.shape) - 0.55, 0, 1
    )
    tone = tone + np.clip(3 * blown, 0, 1) * (0.78 - tone)
    return grid(points, tone=np.clip(tone, 0.02, 0.8))


def cap(wide: float, deep: float, high: float, random: np.random.Generator) -> Body:
    """A cushion of snow on a ledge along x, its foot at y = 0, that bulges over the edge."""
    clay = Clay((-wide / 2 - 0.03, -0.02, -deep), (wide / 2 + 0.03, 2.2 * high + 0.02, deep), cell=0.0042)
    reach = min(0.9 * high + 0.012, 0.58 * wide)
    x, level = 0.75 * reach - wide / 2, random.uniform(0.8, 1.1)
    while x <= wide / 2 - 0.7 * reach:
        level = np.clip(level + random.normal(0, 0.10), 0.55, 1.25)
        size, z = high * level, random.normal(0.05, 0.08) * deep
        radii = (reach, 0.78 * size, 0.56 * deep * random.uniform(0.9, 1.15))
        clay.ball((x, 0.25 * size, z), radii, blend=0.02)
        x += random.uniform(0.3, 0.5) * reach
    y = clay.axes[1][None, :, None]
    clay.field = np.maximum(clay.field, (-0.004 - y).astype(np.float32))
    points, triangles = clay.mesh()
    points = points + 0.0022 * np.stack([solid_noise(points, 0.016, random, octaves=3) for _ in range(3)], axis=1)
    tone = SNOW * (1 + 0.04 * solid_noise(points, 0.008, random, octaves=2))
    return Body(points, triangles, np.zeros((len(points), 2)), np.clip(tone, 0, 0.9))
