"""Blood that was spread, dried and stained: absorbances of its sheets, float32, row 0 at the bottom."""

from __future__ import annotations

import numpy as np
from surfaces import cloudy, noise

TEXEL_UM = 0.2  # a pixel sees 0.5 µm
SIZE_UM = (290.0, 215.0)  # wider than the field of 200 µm × 125 µm and its blur
BY_UM = 0.125  # absorbance of a red cell by its thickness
MIDDLE = np.array(SIZE_UM) / 2


class Film:
    """One sheet, on which cells are laid; lengths in µm."""

    def __init__(self) -> None:
        self.absorbance = np.zeros([round(n / TEXEL_UM) for n in SIZE_UM[::-1]], dtype=np.float32)

    def near(self, at: np.ndarray, reach: float) -> tuple[tuple[slice, slice], np.ndarray, np.ndarray]:
        """The window round a point, and the offsets (µm) of its texels."""
        spans = [slice(max(int((c - reach) / TEXEL_UM), 0), max(int((c + reach) / TEXEL_UM) + 1, 0)) for c in at]
        part = spans[1], spans[0]
        rows, columns = self.absorbance[part].shape
        x = (np.arange(columns) + spans[0].start + 0.5) * TEXEL_UM - at[0]
        y = (np.arange(rows) + spans[1].start + 0.5) * TEXEL_UM - at[1]
        return part, x[None, :], y[:, None]

    def red_cell(self, at: np.ndarray, radius: float, pallor: float, random: np.random.Generator) -> None:
        """A biconcave disc, a little out of round. Thickness by Evans and Fung 1972."""
        part, x, y = self.near(at, 1.4 * radius)
        turn = np.arctan2(y, x)
        shape = 1 + 0.05 * random.normal() * np.cos(2 * turn + random.uniform(0, 6))
        shape = shape + 0.025 * random.normal() * np.cos(3 * turn + random.uniform(0, 6))
        r2 = np.minimum((np.hypot(x, y) / (radius * shape)) ** 2, 1)
        thick = np.sqrt(1 - r2) * (0.81 / pallor + 7.83 * r2 - 4.39 * r2 * r2) * radius / 3.91
        self.absorbance[part] += BY_UM * thick.astype(np.float32)

    def white_cell(self, at: np.ndarray, kind: str, random: np.random.Generator) -> None:
        """A cell with its nucleus; it pushes red cells aside, whose rims it hides."""
        radius, plasm = {"neutrophil": (6.6, 0.13), "lymphocyte": (4.6, 0.24), "eosinophil": (6.8, 0.16)}[kind]
        part, x, y = self.near(at, 1.3 * radius)
        bent = noise((y.size, x.size), (5, 5), random)
        inside = _soft(radius * (1 + 0.05 * bent) - np.hypot(x, y))
        grains = np.clip(noise((y.size, x.size), (y.size / 3, x.size / 3), random), 0, 1)
        body = plasm + (0.45 if kind == "eosinophil" else 0.08) * grains
        nucleus = np.zeros_like(inside)
        if kind == "lymphocyte":
            nucleus = _soft(3.8 * (1 + 0.06 * bent) - np.hypot(x - 0.4, y + 0.2))
        else:
            lobes, start = (2 if kind == "eosinophil" else int(random.integers(3, 6))), random.uniform(0, 6)
            angles = start + np.arange(lobes) * random.uniform(1.0, 1.35)
            knots = 3.1 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
            for k, (a, b) in enumerate(knots):
                nucleus = np.maximum(nucleus, _soft(random.uniform(1.7, 2.3) - np.hypot(x - a, (y - b) * 1.1)))
                if k:  # a thread joins the lobes
                    m = (knots[k] + knots[k - 1]) / 2
                    nucleus = np.maximum(nucleus, _soft(0.8 - np.hypot(x - m[0], y - m[1])))
        chromatin = 0.62 + 0.20 * noise((y.size, x.size), (y.size / 6, x.size / 6), random)
        film = self.absorbance[part]
        film += inside * (body + nucleus * (chromatin - body) - film)

    def speck(self, at: np.ndarray, radius: float, absorbance: float, random: np.random.Generator) -> None:
        """A platelet, or a grain of stain."""
        part, x, y = self.near(at, 2 * radius)
        bent = noise((y.size, x.size), (3, 3), random)
        self.absorbance[part] += absorbance * _soft(radius * (1 + 0.35 * bent) - np.hypot(x, y))


def _soft(inside: np.ndarray) -> np.ndarray:
    """1 within, 0 outside, over a third of a micrometre."""
    return np.clip(inside / 0.35 + 0.5, 0, 1).astype(np.float32)


def films(params: dict[str, object], random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Absorbances of the film of cells and of what lies under it."""
    upper, lower = Film(), Film()
    radius, pallor = float(params["red_um"]) / 2, float(params["pallor"])
    wished = int(float(params["cells_per_mm2"]) * SIZE_UM[0] * SIZE_UM[1] * 1e-6)
    thin = 0.75 + 0.5 * cloudy((60, 80), 3, 2, random)  # the film is thicker here than there
    white = [MIDDLE + random.uniform(-45, 45, 2) * [1, 0.6] for _ in range(int(random.integers(3, 6)))]
    placed: list[np.ndarray] = []
    for _ in range(40 * wished):
        at = random.uniform((0, 0), SIZE_UM)
        if len(placed) >= wished:
            break
        share = thin[int(at[1] / SIZE_UM[1] * 60), int(at[0] / SIZE_UM[0] * 80)]
        close = radius * random.choice([1.1, 1.9, 2.05]) / max(share, 0.6)
        if placed and np.min(np.hypot(*(np.array(placed) - at).T)) < close:
            continue
        placed.append(at)
        if min(np.hypot(*(at - b)) for b in white) < radius + 5.5:
            continue
        size = radius * np.clip(random.normal(1, 0.06), 0.8, 1.2)
        (lower if random.random() < 0.06 else upper).red_cell(at, float(size), pallor, random)
    for at in white:
        kind = random.choice(["neutrophil", "neutrophil", "lymphocyte", "eosinophil"])
        upper.white_cell(at, str(kind), random)
    for _ in range(30):
        upper.speck(random.uniform((0, 0), SIZE_UM), random.uniform(0.8, 1.5), random.uniform(0.15, 0.3), random)
    for _ in range(50):
        lower.speck(random.uniform((0, 0), SIZE_UM), random.uniform(0.3, 0.7), random.uniform(0.1, 0.4), random)
    plasma = 0.02 + 0.008 * cloudy(upper.absorbance.shape, 30, 4, random)
    stain = float(params["stain"])
    return stain * (upper.absorbance + plasma), stain * lower.absorbance
