"""The chart, drawn in micrometres: every mark is made of convex quadrilaterals, float64 (n, 4, 2).

MIL-STD-150A: 2^(group + (element - 1)/6) line pairs a millimetre, three lines a direction, five widths long.
"""

from __future__ import annotations

import numpy as np

COARSEST, PAIRS = 4, 3  # groups (4, 5), (6, 7), (8, 9): lines of 31 µm down to 0.55 µm
NEST = 2.3  # widths of its coarsest line that a pair puts the next one off its own middle: the gap lies there
GAP = 0.2  # share of an element's height that is left empty below it

# Seven strokes of a numeral: its corners from the top left, down each side in turn.
_NODES = np.array([(0, 2), (1, 2), (0, 1), (1, 1), (0, 0), (1, 0)], dtype=np.float64)
_STROKES = {
    "1": ((1, 5),),
    "2": ((0, 1), (1, 3), (3, 2), (2, 4), (4, 5)),
    "3": ((0, 1), (1, 3), (2, 3), (3, 5), (4, 5)),
    "4": ((0, 2), (2, 3), (1, 5)),
    "5": ((1, 0), (0, 2), (2, 3), (3, 5), (5, 4)),
    "6": ((1, 0), (0, 4), (2, 3), (3, 5), (4, 5)),
    "7": ((0, 1), (1, 5)),
    "8": ((0, 1), (2, 3), (4, 5), (0, 4), (1, 5)),
    "9": ((0, 1), (2, 3), (0, 2), (1, 5), (4, 5)),
}
_PEN = 0.26  # width of a stroke in half heights of a numeral


def chart() -> np.ndarray:
    """All marks; the origin lies in the middle of the second pair of groups."""
    marks = []
    x0 = -NEST * line_width(COARSEST, 1)
    for nest in range(PAIRS):
        group = COARSEST + 2 * nest
        even, odd = _column(group, range(2, 7)), _column(group + 1, range(1, 7))
        unit = line_width(group, 1)
        top = 11.0 * unit
        marks += [_moved(even, x0 - 12 * unit, top), _moved(odd, x0 + 8 * unit, top)]
        marks.append(_moved(_element(unit), x0 + 2 * unit, top - 22 * unit))
        marks.append(_moved(numeral(1, 2.2 * unit), x0 + 14.8 * unit, top - 20.5 * unit))
        for number, x in ((group, -7.0), (group + 1, 9.5)):
            marks.append(_moved(numeral(number, 2.4 * unit), x0 + x * unit, top + 0.7 * unit))
        x0 += NEST * unit
    return np.concatenate(marks)


def line_width(group: int, element: int) -> float:
    """Width of a line in µm."""
    return 500.0 / 2.0 ** (group + (element - 1) / 6)


def numeral(number: int, height: float) -> np.ndarray:
    """A digit with its lower left corner at the origin."""
    quads = []
    for a, b in _STROKES[str(number)]:
        start, stop = _NODES[a], _NODES[b]
        along = (stop - start) / np.linalg.norm(stop - start) * _PEN / 2
        across = np.array([-along[1], along[0]])
        quads.append([start - along - across, stop + along - across, stop + along + across, start - along + across])
    return np.array(quads) * height / 2


def _column(group: int, elements: range) -> np.ndarray:
    """Elements one below the other with their numbers; the first has its upper left corner at the origin."""
    marks, y = [], 0.0
    for element in elements:
        width = line_width(group, element)
        marks.append(_moved(_element(width), 0, y - 5 * width))
        marks.append(_moved(numeral(element, 2.2 * width), -2.2 * width, y - 3.6 * width))
        y -= 5 * width * (1 + GAP)
    return np.concatenate(marks)


def _element(width: float) -> np.ndarray:
    """Three upright lines and three that lie, 12 by 5 widths, lower left corner at the origin."""
    lines = []
    for k in range(3):
        lines += [(7 + 2 * k, 0, 1, 5), (0, 2 * k, 5, 1)]
    x, y, w, h = np.array(lines, dtype=np.float64).T
    corners = [(x, y), (x + w, y), (x + w, y + h), (x, y + h)]
    return np.moveaxis(np.array(corners), -1, 0) * width


def specks(count: int, half: tuple[float, float], random: np.random.Generator) -> np.ndarray:
    """Splashes of chromium that the etch left: two turned quadrilaterals each, 1 to 7 µm across."""
    size = 1.0 + random.exponential(1.2, count).clip(max=6.0)
    quads = []
    for s in size:
        at = random.uniform(-1, 1, 2) * half
        for _ in range(2):
            angle = np.sort(random.uniform(0, 2 * np.pi) + np.arange(4) * np.pi / 2 + random.uniform(-0.4, 0.4, 4))
            ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * random.uniform(0.5, 1.0, (1, 2))
            quads.append(at + ring * s / 2)
    return np.array(quads).reshape(-1, 4, 2)


def _moved(quads: np.ndarray, x: float, y: float) -> np.ndarray:
    return quads + np.array([x, y])
