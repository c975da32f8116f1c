"""Cars: a lofted body, four wheels and trim; in metres, the nose towards +x, wheels on y = 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from meshes import Body, body, box, grid, joined, tube

TEXEL_M = 0.009  # a pixel sees 27 mm at the target
STATIONS, AROUND = 72, 29
HEIGHT_M = 1.95  # of the side picture


@dataclass(frozen=True)
class Kind:
    """Side view of a car in metres; x counts from the middle, forward.

    roof : (x, y) of the outline from tail to nose. glass : x of the foot of the rear and of the front window,
    and of their tops. belt : height of the window sills. axles : x of rear and front wheel.
    """

    length: float
    width: float
    roof: tuple[tuple[float, float], ...]
    glass: tuple[float, float, float, float]
    belt: float
    axles: tuple[float, float]
    wheel: float
    pillars: tuple[float, ...]

    @property
    def top(self) -> float:
        return max(y for _, y in self.roof)


KINDS = {
    "hatchback": Kind(
        3.95, 1.72,
        ((-1.97, 0.62), (-1.93, 0.95), (-1.72, 1.30), (-1.45, 1.42), (-0.6, 1.49), (0.1, 1.47), (0.45, 1.36),
         (1.02, 0.98), (1.45, 0.90), (1.78, 0.80), (1.94, 0.66), (1.97, 0.55)),
        (-1.90, 1.02, -1.60, 0.34), 0.93, (-1.22, 1.27), 0.305, (-0.92, 0.02),
    ),
    "saloon": Kind(
        4.62, 1.80,
        ((-2.31, 0.66), (-2.27, 0.98), (-2.10, 1.06), (-1.62, 1.09), (-0.92, 1.37), (-0.35, 1.45),
         (0.15, 1.44), (0.55, 1.32), (1.18, 0.98), (1.75, 0.88), (2.12, 0.77), (2.28, 0.64), (2.31, 0.52)),
        (-1.56, 1.18, -0.98, 0.46), 0.95, (-1.36, 1.42), 0.320, (-0.55, 0.12),
    ),
    "estate": Kind(
        4.70, 1.82,
        ((-2.35, 0.66), (-2.32, 1.02), (-2.12, 1.36), (-1.85, 1.46), (-0.8, 1.52), (0.1, 1.50), (0.52, 1.38),
         (1.18, 1.00), (1.78, 0.90), (2.16, 0.78), (2.32, 0.64), (2.35, 0.52)),
        (-2.28, 1.18, -2.02, 0.44), 0.97, (-1.42, 1.46), 0.325, (-1.42, -0.55, 0.14),
    ),
    "van": Kind(
        4.95, 1.90,
        ((-2.47, 0.60), (-2.47, 1.60), (-2.40, 1.86), (-2.15, 1.92), (-0.5, 1.93), (0.75, 1.90), (1.05, 1.78),
         (1.66, 1.22), (2.10, 1.08), (2.38, 0.86), (2.46, 0.62), (2.47, 0.52)),
        (-2.42, 1.70, -2.38, 0.98), 1.12, (-1.52, 1.60), 0.340, (0.10,),
    ),
}  # fmt: skip


def shell(kind: Kind) -> Body:
    """The body without wheels; its texture coordinates count columns and rows of :func:`skin`."""
    half = kind.length / 2
    x = -half * np.cos(np.linspace(0, np.pi, STATIONS))
    top = _smooth(np.interp(x, *np.array(kind.roof).T), 2)
    end = np.clip(1 - np.abs(x) / half, 0, 1)
    width = kind.width / 2 * (1 - 0.30 * np.exp(-end / 0.045) - 0.06 * np.exp(-end / 0.25))
    sill = 0.20 + 0.10 * np.exp(-end / 0.03) + 0.02 * np.cos(np.pi * x / half)
    shoulder = np.minimum(kind.belt, top - 0.06)
    house = np.clip((top - shoulder) / 0.45, 0, 1)  # 0 on bonnet and boot, 1 under the roof
    knots = np.array([0.0, 0.10, 0.32, 0.56, 0.80, 1.0])
    z = np.stack([0.80 * width, width * 0.985, width, 0.975 * width, width * (0.90 - 0.16 * house), 0 * x], 1)
    low = sill + 0.05
    y = np.stack([sill, low, 0.5 * (low + shoulder), shoulder, top - 0.035 - 0.03 * house, top], 1)
    at = np.linspace(0, 1, AROUND // 2 + 1)
    z, y = (np.stack([np.interp(at, knots, row) for row in part]) for part in (z, y))
    z, y = _smooth(z, 1, 1), _smooth(y, 1, 1)
    left = np.stack([np.broadcast_to(x[:, None], z.shape), y, z], axis=2)
    right = left[:, -2::-1] * [1, 1, -1]
    hull = np.concatenate([left, right, left[:, :1]], axis=1)  # closed underneath
    caps = [np.repeat(hull[i : i + 1].mean(axis=1, keepdims=True), hull.shape[1], 1) for i in (0, -1)]
    return _skinned(grid(np.concatenate([caps[0], hull, caps[1]])), kind)


def _skinned(made: Body, kind: Kind) -> Body:
    """Every triangle takes its texture from the view it faces most: side, top, front or tail."""
    a, b, c = (made.vertices[made.triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    middle = (a + b + c)[:, 0] / 3
    facing = np.abs(normal)
    view = np.where(facing[:, 2] >= np.maximum(0.8 * facing[:, 0], facing[:, 1] * 0.7), 0, 1)
    blunt = facing[:, 0] > np.maximum(1.1 * facing[:, 1], 1.25 * facing[:, 2])
    strip = np.tile(np.arange(len(normal) // 2) // (2 * (AROUND // 2) + 1), 2)
    blunt |= (strip == 0) | (strip == strip.max())  # the flat caps
    view = np.where(blunt, np.where(middle > 0, 2, 3), view)
    x, y, z = made.vertices.T
    side, wide = side_rows(), wide_rows(kind)
    columns = int(kind.length / TEXEL_M)
    across, tall = (x / kind.length + 0.5) * columns, 1 - np.clip(y / HEIGHT_M, 0, 1)
    aside = (z / kind.width + 0.5) * wide
    maps = [
        (across, tall * side),
        (across, side + (z / kind.width + 0.5) * (wide - 1)),
        (aside, side + wide + tall * (wide - 1)),
        (aside + int(0.5 * columns), side + wide + tall * (wide - 1)),
    ]
    count = len(made.vertices)
    uv = np.concatenate([np.stack(m, axis=1) for m in maps])
    vertices = np.tile(made.vertices, (4, 1))
    return body(vertices, made.triangles + count * view[:, None], uv=uv)


def side_rows() -> int:
    """Rows of the side picture."""
    return int(HEIGHT_M / TEXEL_M)


def wide_rows(kind: Kind) -> int:
    """Rows of the pictures of top, nose and tail."""
    return int(kind.width / TEXEL_M)


def wheel(kind: Kind) -> Body:
    """A tyre with a five-spoke rim, about the origin, its axle along z; both faces alike."""
    r, angle = kind.wheel, np.linspace(0, 2 * np.pi, 61)
    rings = [(0, 0.085, 0.30), (0.22, 0.085, 0.30), (0.24, 0.075, 0.50), (0.60, 0.075, 0.50),
             (0.62, 0.09, 0.45), (0.68, 0.095, 0.40), (0.70, 0.095, 0.045), (0.96, 0.095, 0.045),
             (1.0, 0.08, 0.04)]  # fmt: skip
    rings += [(radius, -z, tone) for radius, z, tone in reversed(rings)]
    radius, z, tone = (np.array(part)[:, None] for part in zip(*rings, strict=True))
    points = np.stack([r * radius * np.cos(angle), r * radius * np.sin(angle), np.broadcast_to(z, (len(z), 61))], 2)
    spoke = np.where((radius > 0.23) & (radius < 0.61) & (np.cos(5 * angle) < 0.1), 0.06, tone)
    return grid(points, tone=spoke)


def trim(kind: Kind) -> Body:
    """Underbody, mirrors, wipers' box, and an aerial."""
    half, w = kind.length / 2, kind.width / 2
    foot = kind.glass[1]
    mirrors = [
        box(
            (foot - 0.30, kind.belt, s * (w + 0.10) - 0.10),
            (foot - 0.12, kind.belt + 0.15, s * (w + 0.10) + 0.10),
            0.04,
        )
        for s in (-1, 1)
    ]
    under = box((-half + 0.22, 0.15, -0.8 * w), (half - 0.22, 0.36, 0.8 * w), 0.02)
    aerial = tube([(kind.glass[2] + 0.25, kind.top - 0.03, 0), (kind.glass[2] - 0.1, kind.top + 0.30, 0)], 0.012)
    return joined([*mirrors, under, aerial])


def _smooth(values: np.ndarray, passes: int, axis: int = 0) -> np.ndarray:
    """Averages of neighbours along an axis, the ends kept."""
    out = np.moveaxis(np.array(values, dtype=np.float64), axis, 0)
    for _ in range(passes):
        out[1:-1] = 0.25 * out[:-2] + 0.5 * out[1:-1] + 0.25 * out[2:]
    return np.moveaxis(out, 0, axis)
