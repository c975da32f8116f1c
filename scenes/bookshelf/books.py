"""A row of books: which stand on it, where, and their meshes with one picture for all spines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import spines
from shapes import matte, mesh, satin

M_PER_MM = 1e-3
ARC = 8  # pieces of a rounded back
HEIGHTS = (0.82, 1.0)  # of a book, in the tallest's


@dataclass(frozen=True)
class Book:
    """One book, in millimetres. left : of its lower left corner; back : of its spine behind the front."""

    thick: float
    high: float
    deep: float
    look: spines.Look
    volume: int | None
    left: float
    back: float
    lean_deg: float = 0.0


def row(
    begin_mm: float, end_mm: float, tallest_mm: float, share: float, contrast: float, random: np.random.Generator
) -> list[Book]:
    """Books from begin to end, upright: editions of equal backs (a share of the width) and single ones."""
    books: list[Book] = []
    left = begin_mm
    while left < end_mm:
        kind = "journal" if random.random() < 0.4 else "cloth"
        alike = random.random() < share
        for volume in range(
            int(random.integers(7, 12) if kind == "journal" else random.integers(4, 7)) if alike else 1
        ):
            if volume == 0:
                kind = kind if alike else str(random.choice(["cloth", "paper", "paper"]))
                look = spines.new_look(kind, contrast, random)
                low, high = {"cloth": (17, 30), "paper": (10, 21), "journal": (7.0, 9.0)}[kind]
                thick, tall = random.uniform(low, high), tallest_mm * random.uniform(*HEIGHTS)
            back = random.uniform(0, 2.0 if alike else 14.0)
            number = volume if alike else None
            books.append(Book(thick, tall, 0.68 * tall, look, number, left, back))
            left += thick + 0.5
    return [book for book in books if book.left + book.thick < end_mm]


def leaning(
    left_mm: float, tallest_mm: float, lean_deg: float, contrast: float, random: np.random.Generator
) -> list[Book]:
    """An upright hardback and two paperbacks: one leans against it, the other against that one."""
    angle = np.radians(lean_deg)
    thick, high = random.uniform(22, 30), tallest_mm * random.uniform(*HEIGHTS)
    stop = spines.new_look("cloth", contrast, random)
    books = [Book(thick, high, 0.68 * high, stop, None, left_mm, random.uniform(0, 6))]
    heights = high * random.uniform(0.86, 0.97, 2)
    left = left_mm + thick + 0.6 + heights[0] * np.sin(angle)
    for high in heights:
        thick, look = random.uniform(13, 24), spines.new_look("paper", contrast, random)
        books.append(Book(thick, high, 0.68 * high, look, None, left, random.uniform(2, 10), lean_deg))
        left += thick / np.cos(angle) + 0.4
    return books


def meshes(
    prefix: str, books: list[Book], board_m: float, front_m: float, texel_mm: float, random: np.random.Generator
) -> dict[str, Any]:
    """Shapes of a row on the board at this height: spines of cloth, spines of paper, covers, page blocks."""
    prints = [
        spines.spine((round(b.high / texel_mm), round(b.thick / texel_mm)), texel_mm, b.look, b.volume, random)
        for b in books
    ]
    starts = np.cumsum([0] + [p.shape[1] + 4 for p in prints])
    atlas = np.full((max(p.shape[0] for p in prints), starts[-1]), 0.3, dtype=np.float32)
    for picture, start in zip(prints, starts, strict=False):
        atlas[: picture.shape[0], start : start + picture.shape[1]] = picture
        atlas[: picture.shape[0], start + picture.shape[1] : start + picture.shape[1] + 4] = picture[:, -1:]
    parts: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {"cloth": [], "paper": [], "covers": [], "pages": []}
    for book, picture, start in zip(books, prints, starts, strict=False):
        scale = np.array([atlas.shape[1], atlas.shape[0]])
        first, size = np.array([start, atlas.shape[0] - picture.shape[0]]), np.array(picture.shape[::-1])

        def on_print(u, v, first=first, size=size, scale=scale):
            return (first + np.stack(np.broadcast_arrays(u, v), axis=-1) * size) / scale

        _book(book, board_m, front_m, on_print, parts)
    look = {"cloth": matte(atlas), "paper": satin(atlas, 0.3), "covers": matte(atlas), "pages": matte(_pages(random))}
    shapes = {}
    for kind, grids in parts.items():
        if grids:
            name = f"{prefix}_{kind}"
            shapes[name] = mesh(name, *_joined(grids), look[kind], smooth=False)
    return shapes


def _book(book: Book, board_m: float, front_m: float, on_print: Any, parts: dict[str, list]) -> None:
    """Adds a book's grids of (points, uv): rounded back, two covers, and the head of its pages."""
    angle = np.radians(book.lean_deg)
    c, s = np.cos(angle), np.sin(angle)

    def placed(x, y, z):
        x, y, z = (np.asarray(part, dtype=float) for part in np.broadcast_arrays(x, y, z))
        place = [book.left + c * x - s * y, s * x + c * y, -book.back - z]
        return np.stack(place, axis=-1) * M_PER_MM + [0, board_m, front_m]

    u, v = np.linspace(0, 1, ARC + 1), np.array([0.0, 1.0])[:, None]
    bulge = {"cloth": 0.12, "paper": 0.03, "journal": 0.0}[book.look.kind] * book.thick
    round_ = bulge * (2 * u - 1) ** 2
    kind = "cloth" if book.look.kind == "cloth" else "paper"
    parts[kind].append((placed(u * book.thick, v * book.high, round_), on_print(u, v)))
    deep = np.array([bulge, book.deep])
    for side in (0.0, 1.0):  # the colour at the edge of the back runs on over the cover
        points = placed(side * book.thick, v * book.high, deep if side else deep[::-1])
        parts["covers"].append((points, on_print(np.full(2, 0.02 + 0.96 * side), v)))
    inset = 2.5 if kind == "cloth" else 0.0
    x = np.array([0.06, 0.94]) * book.thick
    head = placed(x, book.high - inset, np.array([[bulge + 1.0], [book.deep]]))
    parts["pages"].append((head, np.stack(np.broadcast_arrays(x / 40, np.array([[0.0], [1.0]])), axis=-1)))


def _joined(grids: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, faces and texture places of all grids in one."""
    faces, first = [], 0
    for points, _ in grids:
        rows, columns = points.shape[:2]
        corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel() + first
        faces += [np.stack([corner, corner + 1, corner + columns + 1], 1)]
        faces += [np.stack([corner, corner + columns + 1, corner + columns], 1)]
        first += rows * columns
    flat = [np.concatenate([grid[k].reshape(-1, grid[k].shape[-1]) for grid in grids]) for k in (0, 1)]
    return flat[0], np.concatenate(faces), flat[1]


def _pages(random: np.random.Generator) -> np.ndarray:
    """Edges of leaves."""
    leaves = random.uniform(0.35, 0.75, (1, 256)).astype(np.float32)
    return np.repeat(leaves, 8, axis=0)
