"""The raster of the pictures, and how it lies on the anther."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from anatomy import Implicit

TEXEL_UM = 0.6  # a pixel sees 2 µm
SIZE_UM = (936.0, 636.0)  # wider than the field of 800 µm × 500 µm and its blur
SHAPE = round(SIZE_UM[1] / TEXEL_UM), round(SIZE_UM[0] / TEXEL_UM)


@dataclass(frozen=True)
class View:
    """How the picture lies on the anther: its turn (radians) and the point (µm) that it has in its middle."""

    turn: float
    centre: tuple[float, float]

    def grid(self) -> tuple[np.ndarray, np.ndarray]:
        """Anther coordinates (µm) of the texels; row 0 is the bottom."""
        y, x = np.indices(SHAPE, dtype=np.float32)
        x = (x + 0.5 - SHAPE[1] / 2) * np.float32(TEXEL_UM)
        y = (y + 0.5 - SHAPE[0] / 2) * np.float32(TEXEL_UM)
        c, s = np.float32(np.cos(self.turn)), np.float32(np.sin(self.turn))
        return c * x - s * y + np.float32(self.centre[0]), s * x + c * y + np.float32(self.centre[1])

    def seen(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Row and column of points of the anther."""
        u, v = x - self.centre[0], y - self.centre[1]
        c, s = np.cos(self.turn), np.sin(self.turn)
        return (c * v - s * u) / TEXEL_UM + SHAPE[0] / 2 - 0.5, (c * u + s * v) / TEXEL_UM + SHAPE[1] / 2 - 0.5


def smooth(function: Implicit, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A function of place that hardly bends within a few texels: straight lines between every sixth."""
    every = 6
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
