"""Text set in outline typefaces: widths with kerning, justified paragraphs, ink rasterised exactly, contours.

A typeface is a small file (.npz) in the scene's own folder, packed from a font by ``tools/pack_typeface.py``; its bytes
are part of the scene's digest. All coordinates have x to the right and y downwards, in one unit of the caller's choice;
``at`` is on the baseline. What the methods return are contours, lists of closed polygons (n, 2), which :func:`ink`
turns into a picture, row 0 on top, and which may be joined, turned or scaled before.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

FLATNESS = 3e-4  # largest distance between a curve and its pieces, in em
LOOSEST = 3.0  # cost of a line grows steeply when its blanks are widened by more than so many times
LIGATURES = (("fi", "\ufb01"), ("fl", "\ufb02"))

Contours = list[np.ndarray]


class Line(NamedTuple):
    """A line of a paragraph, which knows whether it is justified."""

    text: str
    indent: float = 0.0
    ends: bool = False
    """True for the last line of a paragraph, which stays ragged."""


class Typeface:
    """Glyphs of one font in em units, read from a file of ``tools/pack_typeface.py``.

    Attributes
    ----------
    cap_height, x_height, ascender, descender : float
        Heights over the baseline, in em; the descender is below 0.
    """

    def __init__(self, path: Path | str) -> None:
        with np.load(path) as held:
            em = float(held["em"])
            heights = held["heights"] / em
            characters = [chr(code) for code in held["characters"]]
            points, on_curve = held["points"] / em, held["on_curve"]
            ends, contours = held["ends"], held["contours"]
            self._advance = dict(zip(characters, (held["advances"] / em).tolist(), strict=True))
            left, right, kern = held["left"], held["right"], (held["kern"] / em).tolist()
        self.cap_height, self.x_height, self.ascender, self.descender = (float(value) for value in heights)
        pairs = ((characters[a], characters[b]) for a, b in zip(left, right, strict=True))
        self._kern = dict(zip(pairs, kern, strict=True))
        starts = np.concatenate([[0], ends])
        polygons = [_flattened(points[a:b], on_curve[a:b]) for a, b in pairwise(starts)]
        first = np.concatenate([[0], np.cumsum(contours, dtype=np.int64)])
        spans = zip(characters, pairwise(first), strict=True)
        self._glyphs = {character: polygons[a:b] for character, (a, b) in spans}

    def width(self, text: str, *, size: float, tracking: float = 0.0) -> float:
        """Width of a line; ``size`` is that of an em, ``tracking`` is added between letters, in em."""
        places, width = self._places(text, tracking)
        return size * (width - (tracking if places else 0.0))

    def line(
        self,
        text: str,
        at: tuple[float, float],
        *,
        size: float,
        align: str = "left",
        tracking: float = 0.0,
        measure: float | None = None,
    ) -> Contours:
        """Contours of a line, its left end, middle or right end at ``at`` (align: left, centre, right).

        measure : widen (or narrow) the blanks until the line is as wide as this, from its left end on.
        """  # fmt: skip
        places, _ = self._places(text, tracking)
        width = self.width(text, size=size, tracking=tracking)
        left = at[0] - {"left": 0.0, "centre": 0.5, "right": 1.0}[align] * width
        blanks = text.count(" ")
        spare = (measure - width) / blanks if measure is not None and blanks else 0.0
        made: Contours = []
        for character, x in places:
            if character == " ":
                left += spare
            shift = np.array([left + size * x, at[1]])
            made += [polygon * np.array([size, -size]) + shift for polygon in self._glyphs[character]]
        return made

    def paragraph(self, text: str, *, size: float, measure: float, indent: float = 0.0) -> list[Line]:
        """Break text into lines of at most this width, without hyphens, so that blanks are as even as can be.

        The sum of squares of what the lines lack is least over the paragraph (dynamic programming). A word wider than
        the measure gets a line of its own.
        """
        words = text.split()
        widths = [self.width(word, size=size) for word in words]
        blank = size * self._advance[" "]
        cost = [0.0] + [np.inf] * len(words)
        start = [0] * (len(words) + 1)
        for stop in range(1, len(words) + 1):
            used = -blank
            for begin in range(stop - 1, -1, -1):
                used += widths[begin] + blank
                spare = measure - (0.0 if begin else indent) - used
                if spare < 0 and begin < stop - 1:
                    break
                each = max(spare, 0.0) / max(stop - begin - 1, 1) / (LOOSEST * blank)
                total = cost[begin] + (0.0 if stop == len(words) else each**2 + each**6)
                if total < cost[stop]:
                    cost[stop], start[stop] = total, begin
        lines, stop = [], len(words)
        while stop:
            begin = start[stop]
            lines.append(Line(" ".join(words[begin:stop]), 0.0 if begin else indent, stop == len(words)))
            stop = begin
        return lines[::-1]

    def column(
        self,
        lines: Iterable[Line],
        at: tuple[float, float],
        *,
        size: float,
        measure: float,
        leading: float,
        align: str = "justified",
    ) -> Contours:
        """Contours of lines below each other, the first baseline at ``at``, ``leading`` from one to the next.

        align : justified, left, centre or right, within the measure that begins at ``at``.
        """  # fmt: skip
        made: Contours = []
        for row, (text, indent, ends) in enumerate(lines):
            y = at[1] + row * leading
            if align in ("justified", "left"):
                room = measure - indent
                full = align == "justified" and (not ends or self.width(text, size=size) > room)
                made += self.line(text, (at[0] + indent, y), size=size, measure=room if full else None)
            else:
                x = at[0] + measure * (0.5 if align == "centre" else 1.0)
                made += self.line(text, (x, y), size=size, align=align)
        return made

    def _places(self, text: str, tracking: float) -> tuple[list[tuple[str, float]], float]:
        """The glyphs of a line with their left ends, and the width behind the last, in em."""
        for plain, joined in LIGATURES if tracking == 0 else ():
            if joined in self._glyphs:
                text = text.replace(plain, joined)
        places, x = [], 0.0
        for k, character in enumerate(text):
            if k:
                x += self._kern.get((text[k - 1], character), 0.0)
            places.append((character, x))
            x += self._advance[character] + tracking
        return places, x


def _flattened(points: np.ndarray, on_curve: np.ndarray) -> np.ndarray:
    """A closed contour of lines and quadratic curves as a polygon (n, 2); no two control points follow each other."""
    parts = []
    for k in np.flatnonzero(on_curve):
        a, b = points[k], points[(k + 1) % len(points)]
        if on_curve[(k + 1) % len(points)]:
            parts.append(a[None])
            continue
        c = points[(k + 2) % len(points)]
        bend = np.sqrt(((a - 2 * b + c) ** 2).sum()) / 4  # of one chord; it falls with the square of their number
        pieces = max(int(np.ceil(np.sqrt(bend / FLATNESS))), 1)
        t = (np.arange(pieces) / pieces)[:, None]
        parts.append((1 - t) ** 2 * a + 2 * t * (1 - t) * b + t * t * c)
    return np.concatenate(parts)


def ink(contours: Sequence[np.ndarray], shape: tuple[int, int], *, scale: float = 1.0) -> np.ndarray:
    """Share of each pixel that the contours cover, float32 (row, col) in 0..1, row 0 on top.

    contours : polygons (x, y), y downwards from the upper left corner. scale : pixels per unit.

    The signed area is exact: an edge adds to the pixels that it crosses, and a sum along the row to all beyond. Where
    contours of one direction overlap, the winding number is above 1 and counts as 1. Outside the picture, they are cut.
    """
    rows, columns = shape
    if not contours:
        return np.zeros(shape, dtype=np.float32)
    start = np.concatenate(contours) * scale
    stop = np.concatenate([np.roll(polygon, -1, axis=0) for polygon in contours]) * scale
    seen = (np.maximum(start[:, 1], stop[:, 1]) > 0) & (np.minimum(start[:, 1], stop[:, 1]) < rows)
    seen &= (start[:, 1] != stop[:, 1]) & (np.minimum(start[:, 0], stop[:, 0]) < columns)
    start, stop = start[seen], stop[seen]
    for axis in (1, 0):
        start, stop = _cut(start, stop, axis)
    middle, rise = (start + stop) / 2, stop[:, 1] - start[:, 1]
    row = np.floor(middle[:, 1]).astype(np.int64)
    within = (row >= 0) & (row < rows)
    x = np.clip(middle[within, 0], 0, columns)
    column = np.floor(x).astype(np.int64)
    place, part, rise = row[within] * (columns + 2) + column, x - column, rise[within]
    cells = rows * (columns + 2)
    area = np.bincount(place, rise * (1 - part), cells) + np.bincount(place + 1, rise * part, cells)
    covered = np.abs(np.cumsum(area.reshape(rows, columns + 2), axis=1)[:, :columns])
    return np.minimum(np.round(covered, 6), 1.0).astype(np.float32)


def _cut(start: np.ndarray, stop: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Edges cut at every whole number along an axis, so that each piece lies between two of them."""
    low = np.floor(np.minimum(start[:, axis], stop[:, axis]))
    count = np.maximum(np.ceil(np.maximum(start[:, axis], stop[:, axis])) - low, 1).astype(np.int64)
    edge = np.repeat(np.arange(len(start)), count)
    step = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    a, way = start[edge], stop[edge] - start[edge]
    along = np.where(way[:, axis] == 0, 1.0, way[:, axis])
    rising = way[:, axis] >= 0
    bounds = low[edge] + np.where(rising, step, count[edge] - 1 - step)
    enters, leaves = ((bounds + np.where(rising, k, 1 - k) - a[:, axis]) / along for k in (0, 1))
    flat = (way[:, axis] == 0) | (count[edge] == 1)
    enters = np.where(flat | (step == 0), 0.0, np.clip(enters, 0, 1))
    leaves = np.where(flat | (step == count[edge] - 1), 1.0, np.clip(leaves, 0, 1))
    return a + enters[:, None] * way, a + leaves[:, None] * way
