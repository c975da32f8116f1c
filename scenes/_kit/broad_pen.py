"""Drawn capitals: each letter is a few strokes of a broad pen, laid down as ink coverage in 0..1.

A stroke is a list of points, two hexadecimal digits each: across (a capital is 8 wide) and up (12 high). One
that begins with ~ is bent smoothly through its points. Rows of a picture run from the top.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

CAP = 12.0  # height of a capital on the grid
GAP, SPACE = 3.2, 5.0  # between letters, and for a blank
BEND = (2, 5)  # straight pieces for one step of a curve: of small letters, and of large ones
LARGE = 40.0  # pixels
SOFT = 0.6  # half width of the rim of a stroke, in pixels

GLYPHS = {
    "A": "00 4c 80|24 64", "B": "0c 00|0c 4c|~4c 7b 77 46|06 46|~46 85 81 40|40 00",
    "C": "~8a 5c 1a 06 12 50 82", "D": "30 00 0c 3c|~3c 7a 86 72 30", "E": "8c 0c 00 80|06 66",
    "F": "8c 0c 00|06 66", "G": "~8a 5c 1a 06 12 50 82|82 85 55", "H": "00 0c|80 8c|06 86", "I": "00 0c",
    "J": "6c 64|~64 51 30 11 04", "K": "00 0c|8c 05|37 80", "L": "0c 00 70", "M": "00 0c 54 ac a0",
    "N": "00 0c 80 8c", "O": "~4c 1a 06 12 40 72 86 7a 4c", "P": "00 0c 4c|~4c 8b 86 45|45 05",
    "Q": "~4c 1a 06 12 40 72 86 7a 4c|54 80", "R": "00 0c 4c|~4c 8b 86 45|45 05|45 80",
    "S": "~7a 5c 2c 0a 18 46 74 82 60 30 02", "T": "0c 8c|4c 40", "U": "0c 04|~04 11 40 71 84|84 8c",
    "V": "0c 40 8c", "W": "0c 30 6a 90 cc", "X": "00 8c|0c 80", "Y": "0c 46 8c|46 40", "Z": "0c 8c 00 80",
    "0": "~3c 1a 06 12 30 52 66 5a 3c", "1": "09 3c 30", "2": "~0a 2c 5c 69 46 00|00 70",
    "3": "~0a 2c 5c 69 36|~36 65 62 40 20 02", "4": "50 5c 04 74", "5": "6c 1c 07|~07 38 66 62 30 01",
    "6": "~6b 3b 07 03 20 40 63 46 05", "7": "0c 7c 20", "8": "~3c 19 36 59 3c|~36 03 30 63 36",
    "9": "~01 31 64 69 4c 2c 09 26 46 69", ".": "00 01", "-": "06 46", ":": "02 03|08 09", "/": "00 6c",
    "&": "80 29|~29 3c 59 04 20 50 85", "'": "0c 09",
}  # fmt: skip


def word(text: str, height: float, *, pen: float = 0.14, contrast: float = 1.0) -> np.ndarray:
    """Ink of a line of text, float32 (row, col) in 0..1, cut close round the letters.

    height : of a capital, in pixels. pen : width of a stem in heights. contrast : stem over hairline; above 1
    it is a book face, at 1 a plain one.
    """
    scale = height / CAP
    stem = max(pen * height / 2, SOFT)
    half = np.array([stem, max(stem / contrast, SOFT)])
    bend = BEND[int(height > LARGE)]
    lines, left = [], 0.0
    for character in text:
        if character == " ":
            left += SPACE
            continue
        strokes = [_points(stroke, bend) for stroke in GLYPHS[character].split("|")]
        lines += [(points + np.array([left, 0.0])) * scale for points in strokes]
        left += max(points[:, 0].max() for points in strokes) + GAP
    margin = np.ceil(half + 1)
    size = np.ceil([(left - GAP) * scale, height]) + 2 * margin
    ink = np.zeros((int(size[1]), int(size[0])), dtype=np.float32)
    for points in lines:
        place = points + margin
        place[:, 1] = size[1] - place[:, 1]
        for start, stop in pairwise(place):
            _draw(ink, start, stop, half)
    return ink


def _points(stroke: str, bend: int) -> np.ndarray:
    """Corners of a stroke on the grid, (n, 2)."""
    corners = stroke.removeprefix("~").split()
    points = np.array([[int(corner[0], 16), int(corner[1], 16)] for corner in corners], dtype=float)
    if not stroke.startswith("~"):
        return points
    at = np.linspace(0, len(points) - 1, bend * (len(points) - 1) + 1)
    first = np.minimum(at.astype(int), len(points) - 2)
    t = (at - first)[:, None]
    slope = np.gradient(points, axis=0)
    if np.array_equal(points[0], points[-1]):  # a ring has no ends
        slope[[0, -1]] = (points[1] - points[-2]) / 2
    a, b, ta, tb = points[first], points[first + 1], slope[first], slope[first + 1]
    return a + t * (ta + t * (3 * (b - a) - 2 * ta - tb + t * (2 * (a - b) + ta + tb)))


def _draw(ink: np.ndarray, start: np.ndarray, stop: np.ndarray, half: np.ndarray) -> None:
    """One straight piece of an elliptic pen, half widths across and down, added in place."""
    low = np.maximum(np.floor(np.minimum(start, stop) - half - 1), 0).astype(int)
    high = np.ceil(np.maximum(start, stop) + half + 1).astype(int)
    window = ink[low[1] : high[1], low[0] : high[0]]
    row, column = np.ogrid[: window.shape[0], : window.shape[1]]
    x, y = (column + 0.5 + low[0] - start[0]) / half[0], (row + 0.5 + low[1] - start[1]) / half[1]
    dx, dy = (stop - start) / half
    along = np.clip((x * dx + y * dy) / max(dx * dx + dy * dy, 1e-12), 0, 1)
    x, y = x - along * dx, y - along * dy
    q = np.hypot(x, y)
    inside = (1 - q) * q / np.maximum(np.hypot(x / half[0], y / half[1]), 1e-9)  # pixels, to first order
    np.maximum(window, np.where(q < 0.1, 1, np.clip(0.5 + inside / (2 * SOFT), 0, 1)), out=window)


def stamp(picture: np.ndarray, ink: np.ndarray, row: float, column: float, grey: float) -> None:
    """Prints ink in this grey, its middle at (row, column), in place; what lies outside is cut off."""
    top, left = round(row - ink.shape[0] / 2), round(column - ink.shape[1] / 2)
    here = picture[max(top, 0) : top + ink.shape[0], max(left, 0) : left + ink.shape[1]]
    part = ink[max(-top, 0) :, max(-left, 0) :][: here.shape[0], : here.shape[1]]
    if part.size:
        here += part * (np.float32(grey) - here)
