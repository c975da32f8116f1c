"""The pictures' texels: where they lie on the anther, which cell each is in, windows and noise on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from anther import Implicit

TEXEL_UM = 0.8  # a pixel sees 2 µm
SIZE_UM = (1080.0, 780.0)  # wider than the field of 800 µm × 500 µm and its blur


@dataclass(frozen=True)
class View:
    """How the picture lies on the anther: its turn (radians) and the point (µm) that it has in its middle."""

    turn: float
    centre: tuple[float, float]

    def grid(self) -> tuple[np.ndarray, np.ndarray]:
        """Anther coordinates (µm) of the texels; row 0 is the bottom."""
        shape = _shape()
        y, x = np.indices(shape, dtype=np.float32)
        x = (x + 0.5 - shape[1] / 2) * np.float32(TEXEL_UM)
        y = (y + 0.5 - shape[0] / 2) * np.float32(TEXEL_UM)
        c, s = np.float32(np.cos(self.turn)), np.float32(np.sin(self.turn))
        return c * x - s * y + np.float32(self.centre[0]), s * x + c * y + np.float32(self.centre[1])

    def seen(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Column and row of a point of the anther."""
        u, v = x - self.centre[0], y - self.centre[1]
        c, s = np.cos(self.turn), np.sin(self.turn)
        rows, columns = _shape()
        return (c * u + s * v) / TEXEL_UM + columns / 2 - 0.5, (c * v - s * u) / TEXEL_UM + rows / 2 - 0.5


def _shape() -> tuple[int, int]:
    return round(SIZE_UM[1] / TEXEL_UM), round(SIZE_UM[0] / TEXEL_UM)


def smooth(function: Implicit, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A function of place that hardly bends within a few texels: straight lines between every fourth."""
    every = 4
    spans = [np.arange(0, n + every, every, dtype=np.float32) for n in x.shape]
    du, dv = (np.array([a[1, 0] - a[0, 0], a[0, 1] - a[0, 0]]) for a in (x, y))
    v, u = np.meshgrid(*spans, indexing="ij")
    values = function(x[0, 0] + du[0] * v + du[1] * u, y[0, 0] + dv[0] * v + dv[1] * u).astype(np.float32)
    for axis, n in enumerate(x.shape):
        at = np.arange(n)
        part = (at % every / np.float32(every))[:, None] if axis == 0 else at % every / np.float32(every)
        here, next_ = (np.take(values, at // every + k, axis=axis) for k in (0, 1))
        values = here + part * (next_ - here)
    return values


def nearest(table: np.ndarray, view: View) -> tuple[np.ndarray, ...]:
    """Distance to the nearest and the second cell in units of their size, those sizes (µm), and the owner."""
    shape = _shape()
    first, second = (np.full(shape, 1e3, np.float32) for _ in range(2))
    wide_1, wide_2 = np.ones(shape, np.float32), np.ones(shape, np.float32)
    owner = np.full(shape, -1, np.int32)
    columns, rows = view.seen(table[:, 0], table[:, 1])
    c, s = np.cos(view.turn), np.sin(view.turn)
    for k, (tx, ty, a, b) in enumerate(table[:, 2:6]):
        reach = 2.6 * max(a, b) / TEXEL_UM
        window = _window(shape, rows[k], columns[k], reach)
        if window is None:
            continue
        v, u = np.ogrid[window]
        u = ((u - columns[k]) * TEXEL_UM).astype(np.float32)
        v = ((v - rows[k]) * TEXEL_UM).astype(np.float32)
        along, across = c * tx + s * ty, c * ty - s * tx  # the cell's direction in the picture
        p, q = u * np.float32(along) + v * np.float32(across), v * np.float32(along) - u * np.float32(across)
        d = np.sqrt((p / np.float32(a)) ** 2 + (q / np.float32(b)) ** 2)
        size = np.sqrt(p * p + q * q) / np.maximum(d, np.float32(1e-3))
        f1, f2, w1, w2, own = (grid[window] for grid in (first, second, wide_1, wide_2, owner))
        near = d < f1
        next_ = ~near & (d < f2)
        np.copyto(f2, np.where(near, f1, d), where=near | next_)
        np.copyto(w2, np.where(near, w1, size), where=near | next_)
        np.copyto(f1, d, where=near)
        np.copyto(w1, size, where=near)
        np.copyto(own, k, where=near)
    return first, second, wide_1, wide_2, owner


def _window(shape: tuple[int, int], row: float, column: float, reach: float) -> tuple[slice, slice] | None:
    """The part of a picture within reach (texels) of a place; None for no texel."""
    spans = []
    for at, n in ((row, shape[0]), (column, shape[1])):
        low, high = max(int(at - reach), 0), min(int(at + reach) + 2, n)
        if high <= low:
            return None
        spans.append(slice(low, high))
    return spans[0], spans[1]


def local(
    shape: tuple[int, int], view: View, at: tuple[float, float], reach_um: float
) -> tuple[tuple[slice, slice], np.ndarray, np.ndarray] | None:
    """A window round a point of the anther, and distance (µm) and angle from it there."""
    column, row = view.seen(np.float64(at[0]), np.float64(at[1]))
    window = _window(shape, float(row), float(column), reach_um / TEXEL_UM)
    if window is None:
        return None
    v, u = np.ogrid[window]
    u, v = (u - column) * TEXEL_UM, (v - row) * TEXEL_UM
    return window, np.hypot(u, v).astype(np.float32), np.arctan2(v, u).astype(np.float32)


def noise(shape: tuple[int, ...], cell_um: float, random: np.random.Generator) -> np.ndarray:
    """Value noise in -1..1, float32, on a lattice of so many µm."""
    scale = TEXEL_UM / cell_um
    lattice = random.uniform(-1, 1, [int(n * scale) + 2 for n in shape]).astype(np.float32)
    for axis in (0, 1):
        at = np.arange(shape[axis], dtype=np.float32) * np.float32(scale)
        low = at.astype(np.int64)
        part = at - low
        part *= part * (3 - 2 * part)
        part = part[:, None] if axis == 0 else part
        here = np.take(lattice, low, axis=axis)
        lattice = here + part * (np.take(lattice, low + 1, axis=axis) - here)
    return lattice
