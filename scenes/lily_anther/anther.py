"""Anatomy of half an anther in cross section: two pollen sacs, their walls, the tissue that joins them.

Micrometres; the origin lies in the septum between the two sacs, the rest of the anther is at negative y. The
outline and the sacs are implicit functions, about the signed distance (negative inside).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

Implicit = Callable[[np.ndarray, np.ndarray], np.ndarray]

EPIDERMIS, ENDOTHECIUM, MIDDLE, TAPETUM, PARENCHYMA, PHLOEM, XYLEM = range(7)
WALL_UM = 104.0  # from a sac to the skin
BUNDLE = (0.0, -345.0), 82.0  # vascular bundle: middle, radius


@dataclass
class Cells:
    """Cells as seeds: place, direction of their length, half length and half width, kind."""

    rows: list[np.ndarray] = field(default_factory=list)

    def add(self, places: np.ndarray, along: np.ndarray, half: np.ndarray, kind: int) -> None:
        """places, along, half: (n, 2) each."""
        self.rows.append(np.column_stack([places, along, half, np.full(len(places), float(kind))]))

    @property
    def table(self) -> np.ndarray:
        """float64 (n, 7): x, y, direction, half length, half width, kind."""
        return np.concatenate(self.rows)


class Anther:
    """The outline, the sacs, and the cells between."""

    def __init__(self, random: np.random.Generator) -> None:
        self._bend = random.uniform(-1, 1, (2, 6))
        self._radii = np.array([[158.0, 126.0], [158.0, 126.0]]) * random.uniform(0.93, 1.07, (2, 2))
        self._lean = random.uniform(-0.25, 0.25, 2) + np.array([0.28, -0.28])
        self.cells = self._cells(random)

    def sac(self, k: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Distance (µm) from the inner face of the tapetum of sac k."""
        u, v = x - (-216.0, 216.0)[k], y - 4.0
        c, s = np.cos(self._lean[k]), np.sin(self._lean[k])
        u, v = c * u + s * v, c * v - s * u
        angle = np.arctan2(v, u)
        a, b, d, e, *_ = self._bend[k]
        wobble = 1 + 0.05 * np.sin(2 * angle + 3 * a) + 0.045 * b * np.sin(3 * angle + 3 * d)
        wobble += 0.02 * e * np.sin(5 * angle)
        rx, ry = self._radii[k]
        k0, k1 = np.hypot(u / rx, v / ry) / wobble, np.hypot(u / rx**2, v / ry**2) / wobble**2
        return k0 * (k0 - 1) / np.maximum(k1, 1e-9)

    def sacs(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Distance (µm) from the nearer sac."""
        return np.minimum(self.sac(0, x, y), self.sac(1, x, y))

    def outline(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Distance (µm) from the skin of the anther, negative inside."""
        body = np.hypot(x / 400.0, (y + 400.0) / 330.0)
        parts = [self.sac(0, x, y) - WALL_UM, self.sac(1, x, y) - WALL_UM, (body - 1) * 330.0]
        soft = 26.0  # the notch between two lobes is rounded
        return -soft * np.log(sum(np.exp(-np.clip(p, -900, 900) / soft) for p in parts))

    def _cells(self, random: np.random.Generator) -> Cells:
        cells = Cells()
        for depth, long, kind in ((11.5, 11.5, EPIDERMIS), (37.0, 14.0, ENDOTHECIUM)):
            self._row(
                cells, lambda x, y, d=depth: self.outline(x, y) + d, (0, 900), long, depth, kind, random
            )
        for k in (0, 1):
            start = ((-216, 216)[k], 700)
            for out, long, wide, kind in (
                (13.0, 13.5, 13.0, TAPETUM),
                (31.0, 19.0, 5.5, MIDDLE),
                (42.5, 20.0, 6.0, MIDDLE),
            ):

                def ring(x: np.ndarray, y: np.ndarray, k: int = k, out: float = out) -> np.ndarray:
                    return self.sac(k, x, y) - out

                self._row(cells, ring, start, long, wide, kind, random, other=1 - k)
        self._fill(cells, random)
        return cells

    def _row(
        self,
        cells: Cells,
        ring: Implicit,
        start: tuple[float, float],
        long: float,
        wide: float,
        kind: int,
        random: np.random.Generator,
        other: int | None = None,
    ) -> None:
        """One layer of cells along a closed curve, ``long`` half a cell's length."""
        path, along = _followed(ring, np.array(start, dtype=np.float64), 2 * long, random)
        x, y = path.T
        keep = np.ones(len(path), dtype=bool)
        if other is not None:  # where the sacs meet each keeps its own side, and the skin its own layers
            mine = ring(x, y)
            if kind != TAPETUM:
                keep = (self.sac(other, x, y) - mine > 1.6 * wide + 8) & (self.outline(x, y) < -50)
        width = {EPIDERMIS: 11.5, ENDOTHECIUM: 14.0}.get(kind, wide)
        half = np.column_stack([np.full(len(path), long), np.full(len(path), width)])
        half *= random.uniform(0.88, 1.12, (len(path), 2))
        shift = random.normal(0, 0.06 * width, (len(path), 2))
        cells.add((path + shift)[keep], along[keep], half[keep], kind)

    def _fill(self, cells: Cells, random: np.random.Generator) -> None:
        """The small cells of the vascular bundle, then ground tissue wherever there is room."""
        (bx, by), radius = BUNDLE
        places = _scattered((bx, by), (2 * radius, 2 * radius), 10.5, random)
        places = places[np.hypot(*(places - (bx, by)).T) < radius]
        size = 5.4 * np.exp(random.normal(0, 0.22, len(places)))
        vessel = places[:, 1] > by - 6 + 14 * np.sin(places[:, 0] / 31 + 1) + random.normal(0, 5, len(places))
        size[vessel] *= random.choice([0.85, 1.5], vessel.sum(), p=[0.7, 0.3])
        for chosen, kind in ((vessel, XYLEM), (~vessel, PHLOEM)):
            self._ground(cells, places[chosen], size[chosen], kind, random)
        for spacing, room in ((28.0, 1.7), (13.0, 2.1)):  # the second time for what the first left empty
            places = _scattered((0, -170), (1000, 860), spacing, random)
            x, y = places.T
            places = places[(self.sacs(x, y) > 45) & (self.outline(x, y) < -50)]
            free = _in_cells(places, cells.table).min(axis=1) > room
            for place in places[free]:
                if spacing > 20 or _in_cells(place[None], cells.table[-40:]).min() > room:
                    size = 15.0 * np.exp(random.normal(0, 0.14, 1))
                    self._ground(cells, place[None], size, PARENCHYMA, random)

    def _ground(
        self, cells: Cells, places: np.ndarray, size: np.ndarray, kind: int, random: np.random.Generator
    ) -> None:
        turn = random.uniform(0, np.pi, len(places))
        half = size[:, None] * random.uniform(0.88, 1.14, (len(places), 2))
        cells.add(places, np.column_stack([np.cos(turn), np.sin(turn)]), half, kind)

    def grains(self, radius: float, random: np.random.Generator) -> list[tuple[float, float, float, float]]:
        """Pollen as (x, y, radius of the cut, its height over the grain's middle in radii); none overlap."""
        tries = 1600
        size = radius * random.uniform(0.9, 1.08, tries)
        lift = np.where(random.random(tries) < 0.8, 0.5, 0.95) * random.uniform(-1, 1, tries)
        cut = size * np.sqrt(1 - lift**2)
        place = random.uniform(-1, 1, (tries, 2)) * (180, 150) + np.where(np.arange(tries) % 2, 216, -216)[
            :, None
        ] * (1, 0)
        free = self.sacs(*place.T) < -cut - 2.5
        placed: list[tuple[float, float, float, float]] = []
        held = np.empty((0, 3))
        for (x, y), r, up in zip(place[free], cut[free], lift[free], strict=True):
            if (np.hypot(held[:, 0] - x, held[:, 1] - y) > held[:, 2] + r + 0.3).all():
                held = np.vstack([held, (x, y, r)])
                placed.append((float(x), float(y), float(r), float(up)))
        return placed


def _in_cells(places: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Distance of each place (n, 2) from each cell (m, 7), in units of the cell's own half size: (n, m)."""
    x, y = (places[:, None, k] - table[None, :, k] for k in (0, 1))
    tx, ty, a, b = table[:, 2:6].T
    return np.hypot((x * tx + y * ty) / a, (y * tx - x * ty) / b)


def _scattered(
    middle: tuple[float, float], size: tuple[float, float], spacing: float, random: np.random.Generator
) -> np.ndarray:
    """Places in a box, about so far apart: a shaken lattice."""
    i, j = np.meshgrid(np.arange(size[0] // spacing + 1), np.arange(size[1] // (0.88 * spacing) + 1))
    x = middle[0] - size[0] / 2 + (i + 0.5 * (j % 2)) * spacing
    y = middle[1] - size[1] / 2 + j * 0.88 * spacing
    return np.stack([x, y], -1).reshape(-1, 2) + random.normal(0, 0.17 * spacing, (i.size, 2))


def _followed(
    ring: Implicit, start: np.ndarray, step: float, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Points round the closed curve where ``ring`` is 0, about a step apart, and the curve's directions."""
    fine, point, points = 8.0, start, []
    for k in range(600):
        for _ in range(8):
            value, gradient = _slope(ring, point)
            move = value * gradient / (gradient @ gradient)
            point = point - move
            if np.abs(move).max() < 0.05:
                break
        points.append(point)
        if k > 4 and np.linalg.norm(point - points[0]) < fine:
            break
        point = point + fine * np.array([-gradient[1], gradient[0]]) / np.linalg.norm(gradient)
    curve = np.array([*points, points[0]])
    length = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(curve, axis=0).T))])
    count = round(length[-1] / step)
    at = (np.arange(count) + random.uniform(-0.17, 0.17, count)) / count * length[-1] % length[-1]
    ahead = (at + 1.0) % length[-1]
    here, there = (np.column_stack([np.interp(a, length, c) for c in curve.T]) for a in (at, ahead))
    return here, (there - here) / np.linalg.norm(there - here, axis=1, keepdims=True)


def _slope(ring: Implicit, point: np.ndarray) -> tuple[float, np.ndarray]:
    x = point[0] + np.array([0, 0.5, -0.5, 0, 0])
    y = point[1] + np.array([0, 0, 0, 0.5, -0.5])
    value = ring(x, y)
    return float(value[0]), np.array([value[1] - value[2], value[3] - value[4]])
