"""Absorbance (decadic) of the anther's tissue as the cut shows it, float32 (row, col)."""

from __future__ import annotations

import numpy as np
from anatomy import ENDOTHECIUM, EPIDERMIS, MIDDLE, PARENCHYMA, PHLOEM, TAPETUM, XYLEM, Anther
from rasters import ELLIPSE, Growth, Seeds, fractal, grow, noise, soft, splat
from view import SHAPE, TEXEL_UM, View, smooth

# By kind: absorbance of wall and of plasm, half thickness of the wall (µm), share of the cells that the cut
# finds a nucleus in, its radius (µm), share of a cell that is vacuole.
LOOK = {
    EPIDERMIS: (0.46, 0.20, 1.05, 0.55, 4.4, 0.75),
    ENDOTHECIUM: (0.42, 0.13, 0.85, 0.5, 4.8, 0.85),
    MIDDLE: (0.40, 0.34, 0.6, 0.45, 3.4, 0.1),
    TAPETUM: (0.38, 0.44, 0.65, 0.8, 5.2, 0.0),
    PARENCHYMA: (0.36, 0.10, 0.75, 0.36, 4.8, 0.9),
    PHLOEM: (0.40, 0.24, 0.7, 0.4, 2.1, 0.4),
    XYLEM: (0.85, 0.02, 1.35, 0.0, 1.0, 1.0),
}


def um(cell: float) -> float:
    """Micrometres in texels."""
    return cell / TEXEL_UM


class Tissue:
    """Which cell each texel is in, and how far it lies from walls, skin and sacs (µm)."""

    def __init__(self, anther: Anther, view: View, random: np.random.Generator) -> None:
        x, y = view.grid()
        self.skin, self.sac = smooth(anther.outline, x, y), smooth(anther.sacs, x, y)
        table = anther.cells
        rows, columns = view.seen(table[:, 0], table[:, 1])
        along = np.arctan2(table[:, 3], table[:, 2]) - view.turn
        one = np.ones(len(table))
        long, wide = um(1) * table[:, 4], um(1) * table[:, 5]
        start = random.normal(0, 0.06, len(table))
        seeds = Seeds(rows, columns, along, long, wide, start, 2.5 * one, np.full(len(table), ELLIPSE), one)
        bend = tuple(um(1.5) * noise(SHAPE, um(13), random) + um(0.55) * noise(SHAPE, um(4.5), random) for _ in "xy")
        self.cells: Growth = grow(SHAPE, seeds, bend=(bend[0], bend[1]))
        self.table, self.along = table, along
        self.rows, self.columns = rows, columns
        self.kinds = table[:, 6].astype(np.int8)
        self.kind = np.where(self.cells.owner >= 0, self.kinds[self.cells.owner], -1)
        self.edge = TEXEL_UM * self.cells.edge
        self.corner = TEXEL_UM * 0.5 * (self.cells.third - self.cells.first) * self.cells.speed

    def of(self, index: int) -> np.ndarray:
        """A column of LOOK at every texel."""
        return np.array([LOOK[k][index] for k in range(len(LOOK))], dtype=np.float32)[self.kind]

    def each(self, values: np.ndarray) -> np.ndarray:
        """A value of every cell at every texel."""
        return values.astype(np.float32)[self.cells.owner]

    def absorbance(self, view: View, random: np.random.Generator) -> np.ndarray:
        """The tissue alone, without what lies in the sacs."""
        count = len(self.table)
        patchy, fine = fractal(SHAPE, um(60), 4, random), noise(SHAPE, um(1.4), random)
        grain = 0.55 * fine + 0.45 * noise(SHAPE, um(2.8), random) + 0.5 * noise(SHAPE, um(7), random)
        gap = self._gaps(random)
        room = np.where(self.kind == PARENCHYMA, 1.8 + 1.6 * patchy, 0.7).clip(0, 4)  # between three cells
        room[(self.kind == TAPETUM) | (self.kind == MIDDLE) | (self.kind == XYLEM)] = 0
        thick = self.of(2) * (1 + 0.35 * noise(SHAPE, um(16), random) + 0.3 * patchy).clip(0.45, 2.2)
        inner = np.minimum(self.edge - gap, 1.2 * (self.corner - room)) - thick
        wall = soft(-inner, 0.9) * (0.8 + 0.2 * np.exp(-((self.edge / 0.45) ** 2)))
        wall *= self.of(0) * (1 + 0.45 * patchy + 0.22 * noise(SHAPE, um(5), random))
        shrunk = np.maximum(random.normal(0.1, 0.9, count), 0) * (random.random(count) < 0.6)
        shrunk[self.kinds == TAPETUM] *= 0.6
        depth = inner - self.each(shrunk) * (1 + 0.8 * noise(SHAPE, um(6), random))
        image = wall + self._plasm(depth, grain, random) * (1 + 0.25 * patchy)
        image = np.maximum(image, self._ribs(inner, random))
        image += self._plastids(depth, random) * (depth > 0)
        self._nuclei(image, random)
        void = soft(gap - self.edge, 0.9) * (gap > 0.05)
        void = np.maximum(void, soft(room - self.corner, 0.9) * (room > 0.2))
        image = image * (1 - void) + 0.02 * void
        return self._skinned(image, random)

    def _gaps(self, random: np.random.Generator) -> np.ndarray:
        """Half width (µm) of the splits along which cells came apart when the section was stretched."""
        gap = np.zeros(SHAPE, dtype=np.float32)
        row, column = np.nonzero((self.edge < 6) & (self.kind != XYLEM) & (self.kind >= 0))
        owner, other = self.cells.owner[row, column], self.cells.other[row, column]
        widest = np.zeros(row.size, dtype=np.float32)
        for _ in range(5):
            towards, at = random.uniform(0, np.pi), random.uniform(0.1, 0.9, 2) * SHAPE
            c, s = np.cos(towards), np.sin(towards)
            long, wide = um(random.uniform(50, 150)), random.uniform(0.8, 3.6)
            phase, wave = random.uniform(0, 6), um(random.uniform(35, 70))
            p, q = (
                c * (self.columns - at[1]) + s * (self.rows - at[0]),
                c * (self.rows - at[0]) - s * (self.columns - at[1]),
            )
            left = q > 0.25 * wave * np.sin(p / wave + phase)
            apart = np.flatnonzero(left[owner] != left[other])
            along = c * (column[apart] - at[1]) + s * (row[apart] - at[0])
            widest[apart] = np.maximum(widest[apart], wide * np.clip(1 - (along / long) ** 2, 0, 1))
        gap[row, column] = widest
        return gap * (1 + np.float32(0.4) * noise(SHAPE, um(11), random))

    def _plasm(self, depth: np.ndarray, grain: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """Plasm: granular, denser along the wall, with a vacuole, threads through it, and small vacuoles."""
        count = len(self.table)
        density = self.each(np.exp(random.normal(0, 0.24, count)) * random.choice([1, 1.35], count, p=[0.92, 0.08]))
        lining = 1.6 + 1.5 * noise(SHAPE, um(8), random) + self.each(random.exponential(0.9, count))
        hollow = self.of(5) * self.each((random.random(count) < 0.88).astype(float))
        vacuole = soft(depth - lining, 1.8) * hollow
        threads = np.abs(noise(SHAPE, um(9), random) + 0.35 * noise(SHAPE, um(3.5), random))
        vacuole *= 1 - 0.55 * soft(0.07 - threads, 0.1)
        drops = fractal(SHAPE, um(4.2), 2, random)
        foam = soft(drops - 0.42, 0.2) * (self.kind == TAPETUM) * soft(depth - 1.5, 1.5)
        plasm = self.of(1) * density * (1 + 0.75 * grain).clip(0.1) * soft(depth, 1.1)
        rim = 0.07 * np.exp(-((depth / 0.8) ** 2)) * (self.kind != XYLEM)
        dense = 1 + 0.9 * np.exp(-np.maximum(depth, 0) / 2.0) * self.of(5)
        return (plasm * dense + rim) * (1 - 0.93 * vacuole) * (1 - 0.75 * foam)

    def _ribs(self, inner: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """Ribs of the endothecium: across each cell, from its inner wall, fading outwards."""
        count = len(self.table)
        row, column = np.ogrid[: SHAPE[0], : SHAPE[1]]
        c, s = self.each(np.cos(self.along)), self.each(np.sin(self.along))
        u, v = column - self.each(self.columns), row - self.each(self.rows)
        along, across = TEXEL_UM * (c * u + s * v), TEXEL_UM * (c * v - s * u)
        slant = self.each(random.normal(0, 0.16, count))
        period = self.each(random.uniform(3.6, 5.2, count))
        wave = (along + slant * across + 0.9 * noise(SHAPE, um(9), random)) / period
        ribs = soft(np.cos(2 * np.pi * wave + self.each(random.uniform(0, 6, count))) - 0.3, 0.7)
        inward = np.clip((-self.skin - 25 + 3 * noise(SHAPE, um(7), random)) / 17, 0.12, 1)
        cut_across = self.each((random.random(count) < 0.35).astype(float))  # then only dots along the wall
        reach = 1 - cut_across * soft(inner - 2.2, 2.0)
        strength = self.each(random.uniform(0.3, 0.62, count))
        return ribs * inward * reach * strength * soft(inner + 0.8, 1.0) * (self.kind == ENDOTHECIUM)

    def _plastids(self, depth: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """Plastids and grains of starch: small discs, most of them along the walls."""
        rows, columns = (random.uniform(0, n - 1, 26000) for n in SHAPE)
        at = rows.astype(int), columns.astype(int)
        away, kind = depth[at], self.kind[at]
        likely = np.array([0.35, 0.3, 0.25, 0.2, 0.42, 0.15, 0.0, 0.0])[kind]
        kept = (away > 0.6) & (random.random(len(rows)) < likely * np.exp(-np.abs(away - 1.5) / 2.5))
        rows, columns = rows[kept], columns[kept]
        large = random.random(kept.sum()) < 0.3
        weight = random.uniform(0.15, 0.5, kept.sum())
        small = splat(SHAPE, rows[~large], columns[~large], 6.5 * weight[~large], blur=1.0)
        return small + splat(SHAPE, rows[large], columns[large], 18 * weight[large], blur=1.75)

    def _nuclei(self, image: np.ndarray, random: np.random.Generator) -> None:
        """Nuclei with chromatin and nucleoli, cut at any height: some lie half below, faint and soft."""
        clumps, fine = fractal((256, 256), um(2.6), 2, random), noise((256, 256), um(1.3), random)
        for k, (_, _, _, _, a, b, kind) in enumerate(self.table):
            _, _, _, share, radius, _ = LOOK[int(kind)]
            paired = kind == TAPETUM and random.random() < 0.5
            for side in (-1, 1) if paired else (random.uniform(-0.6, 0.6),):
                size = radius * random.uniform(0.7, 1.15)
                p, q = 0.4 * side * a, random.uniform(-0.35, 0.35) * b
                c, s = np.cos(self.along[k]), np.sin(self.along[k])
                at = self.rows[k] + um(s * p + c * q), self.columns[k] + um(c * p - s * q)
                if random.random() < share:
                    flat = min(1.0, 0.72 * b / size) * random.uniform(0.72, 1.0)
                    angle = self.along[k] + random.normal(0, 0.3)
                    _nucleus(image, at, (size / flat**0.4, size * flat), angle, (clumps, fine), random)

    def _skinned(self, image: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """Cut off what lies beyond the skin and within the sacs; draw the cuticle and a ragged rim."""
        bulge = np.minimum(self.edge / 7, 1)
        skin = self.skin + 1.6 - 5.5 * bulge + 0.8 * noise(SHAPE, um(9), random)
        ragged = 2.2 * noise(SHAPE, um(6), random) + 1.2 * noise(SHAPE, um(2.2), random)
        hollow = -self.sac - 7.0 * bulge + 3.0 - ragged
        nobody = (self.kind < 0) | ((self.kind != TAPETUM) & (self.sac < 0))
        nobody |= (self.kind != EPIDERMIS) & (self.skin > -2)
        outer = 2.4 * (1 + 0.25 * noise(SHAPE, um(20), random))
        wall = soft(skin + outer, 1.0) * (self.kind == EPIDERMIS)
        image = np.maximum(image, 0.4 * wall * (1 + 0.25 * noise(SHAPE, um(4), random)))
        image += 0.42 * np.exp(-(((skin + 0.5) / 0.75) ** 2)) * (self.kind == EPIDERMIS)
        image = np.where(self.kind == TAPETUM, image * soft(-hollow, 1.2), image * soft(-skin, 1.0))
        image[nobody] = 0
        return image.astype(np.float32)


def _nucleus(
    image: np.ndarray,
    at: tuple[float, float],
    half: tuple[float, float],
    angle: float,
    textures: tuple[np.ndarray, np.ndarray],
    random: np.random.Generator,
) -> None:
    span = int(um(1.6 * max(half))) + 3
    row, column = round(at[0]), round(at[1])
    if not (span < row < SHAPE[0] - span and span < column < SHAPE[1] - span):
        return
    v, u = np.mgrid[-span : span + 1, -span : span + 1]
    v, u = TEXEL_UM * (v + row - at[0]), TEXEL_UM * (u + column - at[1])
    c, s = np.cos(angle), np.sin(angle)
    p, q = c * u + s * v, c * v - s * u
    turn = np.arctan2(q / half[1], p / half[0])
    rim = 1 + 0.06 * np.sin(2 * turn + random.uniform(0, 6)) + 0.05 * np.sin(3 * turn + random.uniform(0, 6))
    inside = (rim - np.hypot(p / half[0], q / half[1])) * half[1]
    low = random.random() < 0.3  # below the plane in focus
    disc = soft(inside, 3.2 if low else 1.0)
    r0, c0 = random.integers(0, 255 - 2 * span, 2)
    clumps, fine = (t[r0 : r0 + 2 * span + 1, c0 : c0 + 2 * span + 1] for t in textures)
    chromatin = 0.36 + 0.26 * soft(clumps - 0.1, 0.4) + 0.1 * fine
    tone = chromatin + 0.22 * np.exp(-(((inside - 0.3) / 0.7) ** 2))
    for _ in range(random.choice([0, 1, 2], p=[0.25, 0.55, 0.2])):
        off, way = random.uniform(0, 0.45) * half[1], random.uniform(0, 2 * np.pi)
        size = random.uniform(0.2, 0.36) * half[1]
        away = size - np.hypot(p - off * np.cos(way), q - off * np.sin(way))
        tone = tone * (1 - 0.5 * soft(away + 0.9, 1.0)) + 0.95 * soft(away, 0.8)
    tone *= random.uniform(0.35, 0.6) if low else random.uniform(0.75, 1.15)
    part = image[row - span : row + span + 1, column - span : column + span + 1]
    part += disc * (np.maximum(tone, part) - part)
