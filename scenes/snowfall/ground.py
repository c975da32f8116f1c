"""The deep snow round the post, the slope to the wood, the wood's far edge; metres, y up."""

from __future__ import annotations

import numpy as np
from solid_noise import solid_noise
from solids import Body, grid, joined, tube
from surfaces import cloudy, noise

SNOW = 0.84


def height(x: np.ndarray, z: np.ndarray, near: float) -> np.ndarray:
    """Height of the snow without its relief: a bank round the post at z = -near, a slope behind it."""
    back = np.maximum(-z - near - 0.5, 0)
    bank = -0.235 - 0.10 * np.minimum(-z - near, 0) ** 2
    return bank - 0.62 * (1 - np.exp(-((back / 2.2) ** 2))) + 0.052 * back


def bank(near: float, foot: tuple[float, float], random: np.random.Generator) -> Body:
    """The snow that is in focus: drifts, ripples, clods from the trees, a hollow round the post."""
    z, x = np.meshgrid(np.linspace(-near + 1.1, -near - 2.0, 560), np.linspace(-1.0, 1.0, 400), indexing="ij")
    flat = np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], axis=1)
    y = height(x, z, near).ravel() + 0.035 * solid_noise(flat, 0.55, random, octaves=2)
    lean = flat[:, 0] * 0.5 + flat[:, 2] + 0.10 * solid_noise(flat, 0.3, random, octaves=2)
    y += 0.005 * np.sin(2 * np.pi * lean / 0.085) * np.clip(0.5 + solid_noise(flat, 0.5, random), 0, 1)
    y += 0.0035 * solid_noise(flat, 0.022, random, octaves=3)
    for _ in range(130):
        at = random.uniform((-0.8, -near - 1.6), (0.8, -near + 0.6))
        r = random.lognormal(np.log(0.011), 0.5)
        d = np.hypot(flat[:, 0] - at[0], flat[:, 2] - at[1]) / r
        y += np.where(d < 3, r * (0.75 * np.exp(-(d**2) * 1.2) - 0.28 * np.exp(-((d - 1.7) ** 2) * 3)), 0)
    d = np.hypot(flat[:, 0] - foot[0], flat[:, 2] - foot[1])
    y += -0.05 * np.exp(-((d / 0.09) ** 2)) + 0.02 * np.exp(-(((d - 0.17) / 0.06) ** 2))
    flat[:, 1] = y
    tone = SNOW * (1 + 0.03 * solid_noise(flat, 0.03, random, octaves=3) + 0.03 * random.standard_normal(len(flat)))
    return grid(flat.reshape(*x.shape, 3)[::1], tone=np.clip(tone, 0, 0.93).reshape(x.shape))


def slope(near: float, random: np.random.Generator) -> Body:
    z, x = np.meshgrid(np.linspace(-near - 1.6, -55, 150), np.linspace(-14, 14, 120), indexing="ij")
    flat = np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], axis=1)
    y = (
        height(x, z, near)
        + (0.14 * solid_noise(flat, 3.0, random, octaves=3)).reshape(x.shape) * np.clip((-z - near - 1.6) / 2, 0, 1)
        - 0.015
    )
    return grid(np.stack([x, y, z], axis=2), tone=0.80)


def stems(near: float, foot: tuple[float, float], random: np.random.Generator) -> Body:
    """Dry grass that pokes out of the snow."""
    made = []
    for _ in range(26):
        k = random.integers(3)
        x = (foot[0] + 0.10, -0.34, 0.40)[k] + random.normal(0, 0.045)
        z = -near + (0.02, 0.12, -0.25)[k] + random.normal(0, 0.05)
        y = float(height(np.array(x), np.array(z), near)) - 0.02
        long, lean = random.uniform(0.05, 0.17), random.normal(0, 0.35, 2)
        t = np.linspace(0, 1, 8)
        path = np.stack(
            [x + lean[0] * long * t**2, y + long * t - 0.15 * long * t**2, z + lean[1] * long * t**2], axis=1
        )
        made.append(tube(path, np.linspace(0.0016, 0.0007, 8), around=5, tone=random.uniform(0.2, 0.42)))
        if random.random() < 0.5:
            ear = path[-1] + np.outer(np.linspace(0, 0.03, 5), [lean[0], 0.6, lean[1]])
            made.append(tube(ear, [0.001, 0.0028, 0.0032, 0.0024, 0.0008], around=6, tone=0.30))
    return joined(made)


def far_wood(random: np.random.Generator) -> np.ndarray:
    """Rows of spruces one behind the other, paler with the distance, some white with snow; row 0 on top."""
    rows, columns = 300, 1100
    picture = np.full((rows, columns), 0.60)
    y = np.arange(rows)[:, None]
    x = np.arange(columns)[None, :]
    for layer, (tone, count) in enumerate(((0.34, 90), (0.22, 70), (0.13, 60))):
        for _ in range(count):
            middle, top = random.uniform(0, columns), random.uniform(0, 130) + 15 * layer
            wide = random.uniform(24, 44)
            a, b = int(max(middle - 1.6 * wide, 0)), int(min(middle + 1.6 * wide, columns))
            down = y - top
            jag = 1 + 0.22 * np.sin(down * 2 * np.pi / random.uniform(13, 19) + random.uniform(0, 6))
            inside = (down > 0) & (np.abs(x[:, a:b] - middle) < wide * np.clip(down / 150, 0, 1.1) ** 0.8 * jag)
            snowy = np.clip(0.5 + 1.5 * noise((rows, b - a), (rows / 7, (b - a) / 9), random), 0, 1)
            own = tone * random.uniform(0.75, 1.2) * (1 + 1.1 * snowy * np.clip(jag - 0.9, 0, 1) * 3)
            picture[:, a:b] = np.where(inside, own, picture[:, a:b])
    veil = np.clip((y - 210) / 90, 0, 1)
    picture += veil * (0.45 - picture)
    return np.clip(picture * (1 + 0.05 * cloudy((rows, columns), 60, 3, random)), 0.02, 0.75)


def flakes(near: float, far: float, dense: float, mean_mm: float, random: np.random.Generator) -> Body:
    """Flakes between two distances from the lens, in what it sees and beyond by the way of a second.

    Each is an aggregate: ragged, bent plates that stick in each other.
    """
    margin = 0.6
    half = np.array([0.118 * far + margin / 2, 0.075 * far + margin])
    count = round(dense * 4 * half[0] * half[1] * (far - near))
    places = random.uniform(-1, 1, (count, 3)) * [*half, 0.5] - [0, 0, 0.5]
    places[:, 2] = -near + (far - near) * places[:, 2]
    inside = np.abs(places[:, :2]) < -places[:, 2:] * [0.118, 0.075] + [margin / 2, margin]
    places = places[inside.all(axis=1)]
    size = 0.5e-3 * mean_mm * random.lognormal(-0.12, 0.5, len(places))
    corner = np.linspace(0, 2 * np.pi, 8)[:-1]
    points = []
    for _ in range(3):
        ragged = random.uniform(0.45, 1.2, (len(places), 7)) * size[:, None] * random.uniform(0.55, 0.9)
        a = random.normal(0, 1, (len(places), 2, 3))
        u = a[:, 0] / np.linalg.norm(a[:, 0], axis=1, keepdims=True)
        v = np.cross(u, a[:, 1])
        v /= np.linalg.norm(v, axis=1, keepdims=True)
        middle = places + 0.45 * size[:, None] * random.normal(0, 1, (len(places), 3))
        rim = middle[:, None] + ragged[..., None] * (
            np.cos(corner)[:, None] * u[:, None] + np.sin(corner)[:, None] * v[:, None]
        )
        hub = middle + 0.3 * size[:, None] * np.cross(u, v)
        points.append(np.concatenate([hub[:, None], rim], axis=1))
    points = np.concatenate(points)
    fan = np.array([(0, k + 1, (k + 1) % 7 + 1) for k in range(7)])
    triangles = (8 * np.arange(len(points))[:, None, None] + fan).reshape(-1, 3)
    flat = points.reshape(-1, 3)
    return Body(flat, triangles, np.zeros((len(flat), 2)), np.full(len(flat), 0.88))
