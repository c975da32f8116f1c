"""What moves in a second, and how fast: at rest the scene stands as at half a second, which no movement changes.

A target is shifted to and fro, turned to and fro about the line towards the lens, or trembles; in some members, what is
behind it is shifted, too. Speeds are those in the picture, in focus, of the fastest point.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from layouts import Target
from sight import Sight

END_S, STILL_S = 1.0, 0.5
MAX_SHIFT, MAX_SHIFT_BEHIND_PX, MAX_TURN = 0.15, 8.0, np.radians(10)  # share of the target's box; pixels; radians
MAX_DEPTH = 0.04  # of the travel: how far a shift goes towards the lens, so that the focus stays within the travel
TREMOR_HZ, TREMOR_S = (2.0, 8.0), 1 / 40  # frequencies, and seconds from pose to pose
MM = 1e-3  # metres

Motion = dict[str, Any]


def movements(params: dict[str, Any], sight: Sight, target: Target) -> dict[str, Motion]:
    """Motions by the names of the parts, as on a scene card."""
    random, speed = np.random.default_rng([4102, int(params["seed"])]), float(params["speed_px_s"])
    kinds = {"shift": _shift, "turn": _turn, "tremble": _tremble}
    moved = {"target": kinds[params["motion"]](speed, sight, target, random)}
    if params["background"] == "shift":
        slower = speed * random.uniform(0.3, 1.0)
        way = _across(random.uniform(0, 2 * np.pi))
        behind = _keyframes(_to_and_fro(slower, MAX_SHIFT_BEHIND_PX), way * sight.pixel)
        moved |= {"things": behind, "wall": behind}
    return moved


def _shift(speed: float, sight: Sight, target: Target, random: np.random.Generator) -> Motion:
    """Across the picture and, at the same time, towards the lens or away from it."""
    most = MAX_SHIFT * min(target.size)
    halves = random.uniform(-1, 1) * min(MAX_DEPTH * sight.travel, 1.0)
    way = _across(random.uniform(0, 2 * np.pi)) * sight.scale(target.halves.min())
    way[2] = -halves * sight.half / max(most, speed * STILL_S)
    return _keyframes(_to_and_fro(speed, most), way)


def _turn(speed: float, sight: Sight, target: Target, random: np.random.Generator) -> Motion:
    """About the middle of the target, by at most MAX_TURN; the corners of its box move at this speed."""
    points = target.body(sight).vertices
    middle = sight.at(*target.centre)
    reach = np.hypot(*np.abs(points - middle)[:, :2].max(axis=0)) / sight.scale(target.halves.min())
    to_and_fro = _to_and_fro(float(random.choice([-1, 1])) * speed / reach, MAX_TURN)
    keyframes = [{"time_s": t, "rotate_deg": float(np.degrees(angle))} for t, angle in to_and_fro]
    return {"keyframes": keyframes, "axis": [0.0, 0.0, 1.0], "centre_m": [float(MM * x) for x in middle]}


def _tremble(speed: float, sight: Sight, target: Target, random: np.random.Generator) -> Motion:
    """As in a hand: three frequencies across and three upwards, from pose to pose at most this fast."""
    times = np.linspace(0, END_S, round(END_S / TREMOR_S) + 1)
    waves = random.uniform(*TREMOR_HZ, (3, 2, 1)), random.uniform(0, 2 * np.pi, (3, 2, 1))
    path = np.sin(2 * np.pi * waves[0] * times + waves[1]).sum(axis=0).T
    path -= path[times.size // 2]  # at STILL_S
    path *= speed * TREMOR_S / max(np.hypot(*(b - a)) for a, b in pairwise(path))
    path *= sight.scale(target.halves.min())
    poses = [{"time_s": float(t), "translate_m": [MM * x, MM * y, 0.0]} for t, (x, y) in zip(times, path, strict=True)]
    return {"keyframes": poses}


def _across(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def _to_and_fro(speed: float, most: float) -> list[tuple[float, float]]:
    """Times (s) and offsets, 0 at STILL_S, at a constant speed that turns back at ``most``."""
    corners = np.arange(most / abs(speed), STILL_S, 2 * most / abs(speed))
    half = np.concatenate([[0.0], corners, [STILL_S]])
    steps = np.diff(half) * speed * np.where(np.arange(half.size - 1) % 2, -1.0, 1.0)
    offsets = np.concatenate([[0.0], np.cumsum(steps)])
    times = np.concatenate([STILL_S - half[:0:-1], STILL_S + half])
    both = np.concatenate([-offsets[:0:-1], offsets])
    return [(float(t), float(x)) for t, x in zip(times, both, strict=True)]


def _keyframes(to_and_fro: list[tuple[float, float]], way: np.ndarray) -> Motion:
    """Shifts along a way (mm for a unit of the offset)."""
    return {"keyframes": [{"time_s": t, "translate_m": [float(MM * x * w) for w in way]} for t, x in to_and_fro]}
