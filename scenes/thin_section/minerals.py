"""The minerals, and which of them grow where in a rock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from rasters import BOX, ELLIPSE, HEXAGON, Growth, Seeds, fractal, grow, noise

SIZE_UM, TEXEL_UM = (1800.0, 1220.0), 1.2  # wider than the field of 1600 µm × 1000 µm; a pixel sees 4 µm
SHAPE = round(SIZE_UM[1] / TEXEL_UM), round(SIZE_UM[0] / TEXEL_UM)


class Mineral(NamedTuple):
    """Birefringence; share let through; relief 0..1; cleavage 0..1; share held back."""

    birefringence: float
    clear: float
    relief: float
    cleavage: float
    reflects: float


MINERALS = {
    "plagioclase": Mineral(0.009, 0.97, 0.12, 0.12, 0.05),
    "quartz": Mineral(0.009, 0.98, 0.10, 0.0, 0.05),
    "microcline": Mineral(0.007, 0.95, 0.16, 0.16, 0.05),
    "augite": Mineral(0.025, 0.82, 0.8, 0.9, 0.06),
    "olivine": Mineral(0.036, 0.93, 0.9, 0.0, 0.06),
    "biotite": Mineral(0.042, 0.75, 0.5, 1.0, 0.05),
    "calcite": Mineral(0.172, 0.95, 0.6, 0.8, 0.07),
    "magnetite": Mineral(0.0, 0.0, 1.0, 0.0, 0.12),
    "glass": Mineral(0.0, 0.6, 0.3, 0.0, 0.05),
    "zircon": Mineral(0.055, 0.9, 1.0, 0.0, 0.08),
}
NAMES = list(MINERALS)


class Crop(NamedTuple):
    """Crystals of one kind: how many and how long (in mean grains), length over width, when they begin
    and how far they grow (units of their own size), form, how much their faces bend."""

    mineral: str
    number: float
    long: float
    slender: tuple[float, float]
    start: tuple[float, float]
    reach: float
    form: int
    bent: float


ROCKS = {
    "gabbro": (
        Crop("plagioclase", 1.15, 0.85, (2.2, 5.0), (0.0, 0.35), 1.5, BOX, 0.06),
        Crop("olivine", 0.16, 0.42, (1.0, 1.5), (-0.3, 0.2), 1.9, HEXAGON, 0.7),
        Crop("augite", 0.34, 0.75, (1.0, 1.5), (0.45, 0.7), 3.2, ELLIPSE, 0.8),
        Crop("plagioclase", 0.3, 0.7, (1.2, 2.0), (0.5, 0.7), 2.6, BOX, 0.5),
        Crop("magnetite", 0.16, 0.28, (1.0, 1.8), (0.2, 0.6), 1.6, ELLIPSE, 1.0),
        Crop("biotite", 0.05, 0.45, (1.5, 3.0), (0.1, 0.4), 1.4, BOX, 0.3),
    ),
    "basalt": (
        Crop("plagioclase", 0.22, 0.62, (2.0, 4.5), (-0.9, -0.5), 1.2, BOX, 0.05),
        Crop("olivine", 0.10, 0.42, (1.0, 1.6), (-0.9, -0.5), 1.2, HEXAGON, 0.35),
        Crop("augite", 0.07, 0.40, (1.0, 1.7), (-0.9, -0.5), 1.2, HEXAGON, 0.15),
        Crop("plagioclase", 62.0, 0.115, (3.2, 8.0), (-0.1, 0.5), 1.1, BOX, 0.02),
        Crop("augite", 40.0, 0.046, (1.0, 1.7), (0.1, 0.6), 1.5, ELLIPSE, 0.2),
        Crop("magnetite", 15.0, 0.022, (1.0, 1.3), (-0.2, 0.2), 1.2, BOX, 0.1),
    ),
    "granite": (
        Crop("biotite", 0.22, 0.55, (1.4, 3.6), (-0.2, 0.2), 1.3, BOX, 0.12),
        Crop("plagioclase", 0.32, 0.62, (1.2, 2.0), (-0.1, 0.3), 2.0, BOX, 0.25),
        Crop("microcline", 0.28, 0.85, (1.0, 1.5), (0.1, 0.4), 2.4, BOX, 0.7),
        Crop("quartz", 0.55, 0.62, (1.0, 1.6), (0.2, 0.6), 3.4, ELLIPSE, 1.0),
        Crop("magnetite", 0.09, 0.16, (1.0, 1.5), (-0.2, 0.1), 1.3, HEXAGON, 0.8),
        Crop("zircon", 0.2, 0.045, (1.3, 2.2), (-0.9, -0.3), 1.0, BOX, 0.2),
    ),
    "marble": (
        Crop("calcite", 1.1, 0.62, (1.0, 1.6), (0.0, 0.5), 3.0, ELLIPSE, 0.9),
        Crop("calcite", 1.2, 0.20, (1.0, 1.4), (0.2, 0.7), 2.0, ELLIPSE, 1.0),
        Crop("quartz", 0.08, 0.22, (1.0, 1.5), (-0.3, 0.2), 1.6, ELLIPSE, 0.6),
        Crop("biotite", 0.07, 0.26, (2.5, 5.0), (-0.4, 0.0), 1.1, BOX, 0.2),
        Crop("magnetite", 0.12, 0.10, (1.0, 1.3), (-0.4, 0.0), 1.1, BOX, 0.3),
    ),
}
REST = {"gabbro": "plagioclase", "basalt": "glass", "granite": "quartz", "marble": "calcite"}  # where nothing grew


@dataclass(frozen=True)
class Fabric:
    """The grain of every texel; of every grain mineral (number in NAMES), place, direction, start."""

    growth: Growth
    kind: np.ndarray
    row: np.ndarray
    column: np.ndarray
    along: np.ndarray
    start: np.ndarray

    @property
    def mineral(self) -> np.ndarray:
        """Number of the mineral at every texel."""
        return self.kind[self.growth.owner]

    def each(self, values: np.ndarray) -> np.ndarray:
        """A value of every grain at every texel."""
        return values.astype(np.float32)[self.growth.owner]


def fabric(rock: str, grain_um: float, random: np.random.Generator) -> Fabric:
    """Let the crystals of a rock grow, the early ones in their own form, the late ones between them."""
    size = grain_um / TEXEL_UM
    field = SHAPE[0] * SHAPE[1] / size**2
    flow = random.uniform(0, np.pi)  # lava flowed: its laths lie more or less parallel
    parts = []
    for crop in ROCKS[rock]:
        n = max(round(crop.number * field), 2)
        long = 0.5 * size * crop.long * np.exp(random.normal(0, 0.3, n))
        slender = random.uniform(*crop.slender, n)
        angle = random.uniform(0, np.pi, n) if rock != "basalt" else random.normal(flow, 0.75, n)
        start = random.uniform(*crop.start, n)
        rim = min(0.5 * size, 90)
        place = random.uniform(-rim, np.array(SHAPE) + rim, (n, 2))
        parts.append(
            np.column_stack(
                [
                    place,
                    angle,
                    2 * long,
                    2 * long / slender,
                    start,
                    start + crop.reach,
                    np.full(n, crop.form),
                    np.full(n, crop.bent),
                    np.full(n, NAMES.index(crop.mineral)),
                ]
            )
        )
    table = np.concatenate(parts)
    bend = [
        0.13 * size * noise(SHAPE, 0.55 * size, random)
        + 0.05 * size * noise(SHAPE, 0.17 * size, random)
        + 1.5 * fractal(SHAPE, 9, 2, random)
        for _ in "xy"
    ]
    seeds = Seeds(*table.T[:7], table[:, 7].astype(int), table[:, 8])
    growth = grow(SHAPE, seeds, bend=(bend[0], bend[1]))
    kind = np.append(table[:, 9].astype(np.int8), NAMES.index(REST[rock]))
    growth.owner[growth.owner < 0] = len(table)
    growth.other[growth.other < 0] = len(table)
    extra = [np.append(column, 0.0) for column in (table[:, 0], table[:, 1], table[:, 2], table[:, 5])]
    return Fabric(growth, kind, *extra)
