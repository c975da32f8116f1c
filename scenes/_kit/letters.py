"""Drawn letters and lines: ink coverage in 0..1 laid on a picture, row 0 on top."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

# Polylines on a grid 4 wide and 6 high, as pairs of digits (across, up); | starts a new stroke.
STROKES = {
    "A": "00 26 40|12 32", "B": "00 06 26 35 34 23 03|23 32 31 20 00", "C": "45 36 16 05 01 10 30 41",
    "D": "00 06 26 44 42 20 00", "E": "40 00 06 46|03 33", "F": "00 06 46|03 33",
    "G": "45 36 16 05 01 10 30 41 43 23", "H": "00 06|40 46|03 43", "I": "20 26",
    "J": "36 31 20 10 01", "K": "00 06|46 03 40", "L": "06 00 40", "M": "00 06 23 46 40",
    "N": "00 06 40 46", "O": "16 05 01 10 30 41 45 36 16", "P": "00 06 36 45 44 33 03",
    "R": "00 06 36 45 44 33 03|23 40", "S": "45 36 16 05 04 13 33 42 41 30 10 01", "T": "20 26|06 46",
    "U": "06 01 10 30 41 46", "V": "06 20 46", "W": "06 10 23 30 46", "X": "00 46|06 40",
    "Y": "06 23 46|23 20", "Z": "06 46 00 40",
    "0": "16 05 01 10 30 41 45 36 16", "1": "05 26 20", "2": "05 16 36 45 44 00 40",
    "3": "06 46 23 33 42 41 30 10 01", "4": "30 36 02 42", "5": "46 06 03 33 42 41 30 10 01",
    "6": "36 16 05 01 10 30 41 42 33 03", "7": "06 46 10",
    "8": "13 04 05 16 36 45 44 33 13 02 01 10 30 41 42 33",
    "9": "10 30 41 45 36 16 05 04 13 43", "-": "13 33", "/": "00 46", ".": "20 21", "~": "03 14 24 32 42 53",
}  # fmt: skip
PITCH = 5.6  # from letter to letter, on that grid


def lines(text: str, height: float, at: tuple[float, float]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Straight pieces (start, stop) of a line of text of this height, its middle ``at`` (x, y)."""
    scale = height / 6
    left = -scale * (PITCH * (len(text) - 1) + 4) / 2
    pieces = []
    for place, letter in enumerate(text):
        for stroke in STROKES.get(letter, "").split("|") if letter in STROKES else ():
            points = np.array([[int(p[0]), int(p[1]) - 3] for p in stroke.split()], dtype=float) * scale
            points += [left + PITCH * scale * place + at[0], at[1]]
            pieces += list(pairwise(points))
    return pieces


def drawn(
    x: np.ndarray, y: np.ndarray, pieces: list[tuple[np.ndarray, np.ndarray]], width: float
) -> np.ndarray:
    """Ink of straight pieces of a round pen, float32 in 0..1, on a grid: x (col,) and y (row,), both rising.

    All in the same unit; the rim of a stroke is one grid step wide.
    """
    ink = np.zeros((y.size, x.size), dtype=np.float32)
    step = abs(x[1] - x[0])
    for start, stop in pieces:
        low, high = np.minimum(start, stop) - width - step, np.maximum(start, stop) + width + step
        columns, rows = (
            slice(*np.searchsorted(axis, (a, b))) for axis, a, b in zip((x, y), low, high, strict=True)
        )
        px, py = x[columns][None, :] - start[0], y[rows][:, None] - start[1]
        dx, dy = stop - start
        along = np.clip((px * dx + py * dy) / max(dx * dx + dy * dy, 1e-12), 0, 1)
        cover = np.clip((width / 2 - np.hypot(px - along * dx, py - along * dy)) / step + 0.5, 0, 1)
        np.maximum(ink[rows, columns], cover, out=ink[rows, columns])
    return ink
