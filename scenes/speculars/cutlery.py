"""Spoon, fork and knife lying on a table: y up, the handle's end at the origin, pointing towards +z.

Each is lofted: stations along its length with a half width, a height of the middle, a hollow and a thickness.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from solids import Body, grid, joined, placed

AROUND = 48


def spoon() -> Body:
    """A tea-spoon, 138 mm."""
    #      z      half   height  hollow thick (mm)
    return _loft(
        [
            (0.0, 1.0, 3.0, 0.0, 0.8),
            (1.5, 4.2, 3.0, 0.0, 1.8),
            (8, 6.2, 3.0, 0.3, 2.2),
            (30, 4.6, 3.6, 0.2, 2.2),
            (62, 2.6, 6.5, 0.0, 2.4),
            (86, 2.3, 8.0, 0.0, 2.6),
            (93, 3.0, 7.6, 0.3, 2.2),
            (99, 8.0, 6.8, 2.2, 1.6),
            (108, 13.2, 5.8, 4.6, 1.3),
            (118, 14.6, 5.6, 5.0, 1.2),
            (128, 12.4, 5.8, 4.2, 1.2),
            (135, 7.4, 6.6, 2.0, 1.1),
            (138, 1.2, 7.4, 0.1, 0.8),
        ]
    )


def fork() -> Body:
    """A cake fork, 150 mm, with four tines."""
    stem = _loft(
        [
            (0.0, 1.0, 3.0, 0.0, 0.8),
            (1.5, 4.4, 3.0, 0.0, 1.8),
            (8, 6.6, 3.0, 0.3, 2.2),
            (32, 4.8, 3.8, 0.2, 2.2),
            (66, 2.7, 7.5, 0.0, 2.5),
            (88, 2.5, 9.0, 0.0, 2.6),
            (95, 4.0, 8.6, 0.2, 2.2),
            (102, 8.6, 7.2, 0.8, 1.7),
            (110, 10.2, 5.4, 1.0, 1.5),
            (113, 10.2, 4.8, 1.0, 1.4),
        ]
    )
    tines = []
    for x in (-8.6, -2.87, 2.87, 8.6):
        bar = _loft(
            [
                (111, 1.6, 5.0, 0, 1.4),
                (116, 1.6, 4.2, 0, 1.4),
                (128, 1.4, 3.2, 0, 1.4),
                (140, 1.2, 4.4, 0, 1.3),
                (148, 0.9, 6.8, 0, 1.0),
                (150, 0.2, 7.6, 0, 0.3),
            ]
        )
        tines.append(placed(bar, [x * 1e-3, 0, 0]))
    return joined([stem, *tines])


def knife() -> Body:
    """A fruit knife, 165 mm, lying on its side."""
    return _loft(
        [
            (0.0, 1.5, 3.5, 0, 1.5),
            (2, 5.5, 3.5, 0, 5.0),
            (12, 7.2, 3.5, 0, 6.5),
            (45, 6.0, 3.5, 0, 6.5),
            (74, 4.8, 3.5, 0, 6.0),
            (78, 5.2, 3.5, 0, 4.0),
            (82, 7.0, 3.2, 0, 1.6),
            (95, 8.4, 3.0, 0, 1.3),
            (130, 8.8, 2.6, 0, 1.2),
            (152, 7.6, 2.3, 0, 1.1),
            (161, 4.4, 2.2, 0, 1.0),
            (165, 0.6, 2.2, 0, 0.6),
        ]
    )


def _loft(stations: Any) -> Body:
    """Rings round the stations (mm), closed lens-like sections that sink by the hollow in their middle."""
    knots = np.asarray(stations, dtype=np.float64) * 1e-3
    fine = np.unique(np.concatenate([np.linspace(knots[0, 0], knots[-1, 0], 110), knots[:, 0]]))
    half, height, hollow, thick = (_monotone(fine, knots[:, 0], knots[:, k]) for k in (1, 2, 3, 4))
    angle = np.linspace(0, 2 * np.pi, AROUND + 1)
    across, up = np.cos(angle), np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** 0.7
    x = half[:, None] * across
    y = height[:, None] - hollow[:, None] * (1 - across**2) + 0.5 * thick[:, None] * up
    y += 1.2e-3  # the lowest hollows stay above the table
    return grid(np.stack([x, y, np.broadcast_to(fine[:, None], x.shape)], axis=2))


def _monotone(at: np.ndarray, knots: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Cubic through the knots without overshoot: slopes are harmonic means of those beside (Fritsch, Butland,
    doi:10.1137/0905021), 0 at tops."""
    step = np.diff(knots)
    rise = np.diff(values) / step
    both = rise[:-1] * rise[1:]
    inner = np.where(both > 0, 2 * both / np.where(both > 0, rise[:-1] + rise[1:], 1), 0)
    slope = np.concatenate([rise[:1], inner, rise[-1:]])
    k = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(step) - 1)
    h, t = step[k], (at - knots[k]) / step[k]
    low, high = values[k], values[k + 1]
    return (
        low * (1 + 2 * t) * (1 - t) ** 2
        + high * t**2 * (3 - 2 * t)
        + h * (slope[k] * t * (1 - t) ** 2 - slope[k + 1] * t**2 * (1 - t))
    )
