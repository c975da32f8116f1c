"""Where the cells of half an anther lie in its cross section: two pollen sacs, walls, tissue between.

Micrometres; the origin lies in the septum between the two sacs, the rest of the anther is at negative y. The
outline and the sacs are implicit functions, about the signed distance (negative inside).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Implicit = Callable[[np.ndarray, np.ndarray], np.ndarray]

EPIDERMIS, ENDOTHECIUM, MIDDLE, TAPETUM, PARENCHYMA, PHLOEM, XYLEM = range(7)
WALL_UM = 106.0  # from a sac to the skin
SACS = (-236.0, 236.0)
BUNDLE = (0.0, -352.0), 88.0  # vascular bundle: middle, radius


class Anther:
    """The outline, the sacs, and a table of cells: x, y, direction (2), half length and half width, kind."""

    def __init__(self, random: np.random.Generator) -> None:
        self._bend = random.uniform(-1, 1, (2, 6))
        self._radii = np.array([[176.0, 140.0]] * 2) * random.uniform(0.93, 1.07, (2, 2))
        self._lean = random.uniform(-0.25, 0.25, 2) + np.array([0.28, -0.28])
        self._rows: list[np.ndarray] = []
        self._layers(random)
        self._bundle(random)
        self._ground(random)
        self.cells = np.concatenate(self._rows)

    def sac(self, k: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Distance (µm) from the inner face of the tapetum of sac k."""
        u, v = x - SACS[k], y - 4.0
        c, s = np.cos(self._lean[k]), np.sin(self._lean[k])
        u, v = c * u + s * v, c * v - s * u
        angle = np.arctan2(v, u)
        a, b, d, e, *_ = self._bend[k]
        wobble = 1 + 0.05 * np.sin(2 * angle + 3 * a) + 0.05 * b * np.sin(3 * angle + 3 * d)
        wobble += 0.03 * e * np.sin(5 * angle) + 0.012 * np.sin(9 * angle + 5 * a)
        rx, ry = self._radii[k]
        k0, k1 = np.hypot(u / rx, v / ry) / wobble, np.hypot(u / rx**2, v / ry**2) / wobble**2
        return k0 * (k0 - 1) / np.maximum(k1, 1e-9)

    def sacs(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Distance (µm) from the nearer sac."""
        return np.minimum(self.sac(0, x, y), self.sac(1, x, y))

    def outline(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Distance (µm) from the skin of the anther, negative inside."""
        body = np.hypot(x / 410.0, (y + 410.0) / 340.0)
        parts = [self.sac(0, x, y) - WALL_UM, self.sac(1, x, y) - WALL_UM, (body - 1) * 340.0]
        blend = 26.0  # the notch between two lobes is rounded
        return -blend * np.log(sum(np.exp(-np.clip(p, -900, 900) / blend) for p in parts))

    def _add(self, places: np.ndarray, along: np.ndarray, half: np.ndarray, kind: int) -> None:
        self._rows.append(np.column_stack([places, along, half, np.full(len(places), float(kind))]))

    def _layers(self, random: np.random.Generator) -> None:
        """Epidermis and endothecium under the skin, tapetum and two middle layers round each sac."""
        for depth, long, wide, kind in ((11.0, 12.5, 11.0, EPIDERMIS), (37.0, 14.5, 15.0, ENDOTHECIUM)):

            def under(x: np.ndarray, y: np.ndarray, depth: float = depth) -> np.ndarray:
                return self.outline(x, y) + depth

            places, along = followed(under, (0, 900), 2 * long, random)
            self._row(places, along, (long, wide), kind, random)
        for k in (0, 1):
            for out, long, wide, kind in (
                (14.0, 13.5, 14.0, TAPETUM),
                (32.5, 21.0, 5.0, MIDDLE),
                (43.0, 22.0, 5.6, MIDDLE),
            ):

                def round_sac(x: np.ndarray, y: np.ndarray, k: int = k, out: float = out) -> np.ndarray:
                    return self.sac(k, x, y) - out

                places, along = followed(round_sac, (SACS[k], 700), 2 * long, random)
                if kind == MIDDLE:  # where the sacs meet each keeps its side, and the skin its own layers
                    x, y = places.T
                    room = self.sac(1 - k, x, y) - round_sac(x, y) - out
                    keep = (room > 1.6 * wide + 8) & (self.outline(x, y) < -50)
                    places, along = places[keep], along[keep]
                self._row(places, along, (long, wide), kind, random)

    def _row(
        self, places: np.ndarray, along: np.ndarray, size: tuple[float, float], kind: int, random: np.random.Generator
    ) -> None:
        half = np.array(size) * np.exp(random.normal(0, 0.13, (len(places), 2)))
        shift = random.normal(0, 0.08 * size[1], (len(places), 2))
        self._add(places + shift, along, half, kind)

    def _bundle(self, random: np.random.Generator) -> None:
        """Vessels among small cells on one side of the bundle, phloem on the other."""
        (bx, by), radius = BUNDLE
        places = scattered((bx, by), (2 * radius, 2 * radius), 10.0, random)
        places = places[np.hypot(*(places - (bx, by)).T) < radius]
        line = by - 6 + 14 * np.sin(places[:, 0] / 31 + 1) + random.normal(0, 6, len(places))
        vessel = places[:, 1] > line
        size = 5.2 * np.exp(random.normal(0, 0.25, len(places)))
        size[vessel] *= random.choice([0.8, 1.75], vessel.sum(), p=[0.72, 0.28])
        for chosen, kind in ((vessel, XYLEM), (~vessel, PHLOEM)):
            self._any_way(places[chosen], size[chosen], kind, random)

    def _ground(self, random: np.random.Generator) -> None:
        """Ground tissue wherever there is room; small cells into what the large ones left."""
        for spacing, room in ((29.0, 1.7), (13.0, 2.0)):
            places = scattered((0, -180), (1060, 900), spacing, random)
            x, y = places.T
            places = places[(self.sacs(x, y) > 46) & (self.outline(x, y) < -50)]
            table = np.concatenate(self._rows)
            places = places[_in_cells(places, table).min(axis=1) > room]
            kept: list[np.ndarray] = []
            for place in places:  # in the second round neighbours would crowd
                if spacing > 20 or not kept or min(np.hypot(*(place - p)) for p in kept[-60:]) > 17:
                    kept.append(place)
            if kept:
                size = 15.5 * np.exp(random.normal(0, 0.2, len(kept)))
                self._any_way(np.array(kept), size, PARENCHYMA, random)

    def _any_way(self, places: np.ndarray, size: np.ndarray, kind: int, random: np.random.Generator) -> None:
        turn = random.uniform(0, np.pi, len(places))
        half = size[:, None] * np.exp(random.normal(0, 0.12, (len(places), 2)))
        self._add(places, np.column_stack([np.cos(turn), np.sin(turn)]), half, kind)

    def grains(self, radius: float, random: np.random.Generator) -> list[tuple[float, float, float, float]]:
        """Pollen as (x, y, radius of the cut, its height over the grain's middle in radii); none overlap."""
        tries = 1500
        size = radius * random.uniform(0.85, 1.1, tries)
        lift = np.where(random.random(tries) < 0.74, 0.5, 0.96) * random.uniform(-1, 1, tries)
        cut = size * np.sqrt(1 - lift**2)
        side = np.where(np.arange(tries) % 2, SACS[1], SACS[0])[:, None] * (1, 0)
        place = random.uniform(-1, 1, (tries, 2)) * (205, 170) + side
        clump = np.sin(place[:, 0] / 47 + radius) + np.sin(place[:, 1] / 39 + 2 * radius)  # they lie unevenly
        free = (self.sacs(*place.T) < -cut - 3.0) & (clump > random.uniform(-1.9, 0.8, tries))
        placed: list[tuple[float, float, float, float]] = []
        held = np.empty((0, 3))
        for (x, y), r, up in zip(place[free], cut[free], lift[free], strict=True):
            if (np.hypot(held[:, 0] - x, held[:, 1] - y) > held[:, 2] + r - 1.0).all():
                held = np.vstack([held, (x, y, r)])
                placed.append((float(x), float(y), float(r), float(up)))
        return placed


def _in_cells(places: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Distance of each place (n, 2) from each cell (m, 7), in units of the cell's own half size: (n, m)."""
    x, y = (places[:, None, k] - table[None, :, k] for k in (0, 1))
    tx, ty, a, b = table[:, 2:6].T
    return np.hypot((x * tx + y * ty) / a, (y * tx - x * ty) / b)


def scattered(
    middle: tuple[float, float], size: tuple[float, float], spacing: float, random: np.random.Generator
) -> np.ndarray:
    """Places in a box, about so far apart: a shaken lattice."""
    i, j = np.meshgrid(np.arange(size[0] // spacing + 1), np.arange(size[1] // (0.88 * spacing) + 1))
    x = middle[0] - size[0] / 2 + (i + 0.5 * (j % 2)) * spacing
    y = middle[1] - size[1] / 2 + j * 0.88 * spacing
    return np.stack([x, y], -1).reshape(-1, 2) + random.normal(0, 0.2 * spacing, (i.size, 2))


def followed(
    ring: Implicit, start: tuple[float, float], step: float, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Points round the closed curve where ``ring`` is 0, about a step apart, and the curve's directions."""
    fine, point, points = 8.0, np.array(start, dtype=np.float64), []
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
    at = (np.arange(count) + random.uniform(-0.22, 0.22, count)) / count * length[-1] % length[-1]
    ahead = (at + 1.0) % length[-1]
    here, there = (np.column_stack([np.interp(a, length, c) for c in curve.T]) for a in (at, ahead))
    return here, (there - here) / np.linalg.norm(there - here, axis=1, keepdims=True)


def _slope(ring: Implicit, point: np.ndarray) -> tuple[float, np.ndarray]:
    x = point[0] + np.array([0, 0.5, -0.5, 0, 0])
    y = point[1] + np.array([0, 0, 0, 0.5, -0.5])
    value = ring(x, y)
    return float(value[0]), np.array([value[1] - value[2], value[3] - value[4]])
