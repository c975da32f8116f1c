"""How muscle cells run through the picture: stripes with dislocations, where one cell branches in two.

All lengths are micrometres. x runs along the fibres, y across; the picture is turned against them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

TEXEL_UM = 0.27  # a pixel sees 0.8 µm
SIZE_UM = (384.0, 272.0)  # wider than the field of 320 µm × 200 µm, its blur and its drift
SHAPE = round(SIZE_UM[1] / TEXEL_UM), round(SIZE_UM[0] / TEXEL_UM)
COARSE = 4  # texels

Spot = tuple[float, float]


@dataclass(frozen=True)
class Fibres:
    """Fields over the texels, float32 (row, col), row 0 at the bottom.

    x, y : along and across all fibres (µm). phase : 2π from one cell to the next, 0 in the middle of a cell.
    across : µm from the middle of the cell, lean : slope of the cell against x. width : of a cell, µm.
    turn : of the fibres in the picture, radians.
    """

    x: np.ndarray
    y: np.ndarray
    phase: np.ndarray
    across: np.ndarray
    lean: np.ndarray
    width: float
    turn: float

    def place(self, x: float, y: float) -> Spot:
        """Row and column of a point."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        column = (c * x - s * y) / TEXEL_UM + SHAPE[1] / 2 - 0.5
        return (s * x + c * y) / TEXEL_UM + SHAPE[0] / 2 - 0.5, column

    def window(self, x: float, y: float, reach: float) -> tuple[slice, slice] | None:
        """The texels within reach (µm) of a point, as a box; None for none."""
        spans = []
        for at, n in zip(self.place(x, y), SHAPE, strict=True):
            low, high = max(int(at - reach / TEXEL_UM), 0), min(int(at + reach / TEXEL_UM) + 2, n)
            if high <= low:
                return None
            spans.append(slice(low, high))
        return spans[0], spans[1]

    def snapped(self, x: float, y: float, *, gap: bool) -> Spot | None:
        """The point moved across the fibres into the middle of its cell, or of a gap; None outside."""
        for _ in range(4):
            row, column = (round(at) for at in self.place(x, y))
            if not (0 <= row < SHAPE[0] and 0 <= column < SHAPE[1]):
                return None
            off = float(self.across[row, column])
            y -= off - np.copysign(self.width / 2, off) if gap else off
        return x, y

    def near(self, x: float, y: float, reach: float) -> tuple[tuple[slice, slice], np.ndarray, np.ndarray] | None:
        """A window round a point on a middle line: texels, and there µm along and across that line."""
        window = self.window(x, y, reach)
        if window is None:
            return None
        row, column = (min(max(round(at), 0), n - 1) for at, n in zip(self.place(x, y), SHAPE, strict=True))
        turns = self.phase[window] - self.phase[row, column]
        along = self.x[window] - x
        return window, along, turns * (self.width / (2 * np.pi))


def run(width: float, turn: float, random: np.random.Generator) -> Fibres:
    """Fibres of this width, turned by so many radians, with some forks."""
    row, column = np.indices(SHAPE, dtype=np.float32)
    u = (column - np.float32(SHAPE[1] / 2 - 0.5)) * np.float32(TEXEL_UM)
    v = (row - np.float32(SHAPE[0] / 2 - 0.5)) * np.float32(TEXEL_UM)
    c, s = np.float32(np.cos(turn)), np.float32(np.sin(turn))
    x, y = c * u + s * v, c * v - s * u
    wave = y.copy()
    for length, swing in ((310.0, 9.0), (170.0, 4.0), (85.0, 1.3)):
        towards, start = random.normal(0, 0.35), random.uniform(0, 2 * np.pi)
        wave += np.float32(swing) * np.sin(
            (x + np.float32(towards) * y) * np.float32(2 * np.pi / length) + np.float32(start)
        )
    phase = wave * np.float32(2 * np.pi / width)
    for k, at in enumerate(_apart(11, 46.0, random)):
        sign = 1 if k % 2 else -1
        # Forks are sharp: the turn of the phase happens within a cell's width of the axis.
        phase += sign * np.arctan2(np.float32(2.2) * (y - np.float32(at[1])), x - np.float32(at[0]))
    middle = np.round(phase / np.float32(2 * np.pi))
    across = (phase / np.float32(2 * np.pi) - middle) * np.float32(width)
    # Slopes of cos and sin do not see where atan2 jumps.
    cos, sin = np.cos(phase), np.sin(phase)
    down, right = (cos * np.gradient(sin, axis=k) - sin * np.gradient(cos, axis=k) for k in (0, 1))
    along_x, along_y = c * right + s * down, c * down - s * right
    lean = along_x / np.maximum(along_y, np.float32(0.2 * 2 * np.pi / width * TEXEL_UM))
    return Fibres(x, y, phase, across, np.clip(lean, -0.8, 0.8), width, turn)


def _apart(count: int, distance: float, random: np.random.Generator) -> list[np.ndarray]:
    """Random points of the picture, no two nearer than that."""
    points: list[np.ndarray] = []
    for _ in range(40 * count):
        point = random.uniform(-0.5, 0.5, 2) * SIZE_UM
        if len(points) < count and all(np.hypot(*(point - p)) > distance for p in points):
            points.append(point)
    return points


def noise(x: np.ndarray, y: np.ndarray, cells: Spot, random: np.random.Generator) -> np.ndarray:
    """Value noise in -1..1, float32, on a lattice of so many µm along x and y."""
    if min(cells) > 3 and x.shape == SHAPE:  # hardly bends between every fourth texel
        return _finer(noise(x[::COARSE, ::COARSE], y[::COARSE, ::COARSE], cells, random))
    at = [a * np.float32(1 / cell) for a, cell in zip((x, y), cells, strict=True)]
    at = [a - a.min() for a in at]
    low = [a.astype(np.int32) for a in at]
    part = [a - b for a, b in zip(at, low, strict=True)]
    part = [p * p * (3 - 2 * p) for p in part]
    columns = int(low[1].max()) + 2
    lattice = random.uniform(-1, 1, (int(low[0].max()) + 2) * columns).astype(np.float32)
    first = low[0] * columns + low[1]
    a, b = lattice[first], lattice[first + 1]
    here = a + part[1] * (b - a)
    a, b = lattice[first + columns], lattice[first + columns + 1]
    return here + part[0] * (a + part[1] * (b - a) - here)


def _finer(values: np.ndarray) -> np.ndarray:
    """A field known at every fourth texel, on straight lines between."""
    for axis, n in enumerate(SHAPE):
        at = np.arange(n)
        part = (at % COARSE / np.float32(COARSE)).astype(np.float32)
        part = part[:, None] if axis == 0 else part
        low = at // COARSE
        here = np.take(values, low, axis=axis)
        there = np.take(values, np.minimum(low + 1, values.shape[axis] - 1), axis=axis)
        values = here + part * (there - here)
    return values
