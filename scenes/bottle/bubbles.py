"""Bubbles of air in oil: where each is, how fast it rises, and where it comes to rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from glass import BASE, PANE, SHOULDER, room_inside

COUNT = {"shaken": 190, "stood_up": 170}
DIAMETER_M = (0.0007, 0.0018)
# 1/(m s): a clean bubble rises at rho g r^2 / (3 mu) while its Reynolds number is small (Hadamard,
# Rybczynski); olive oil at 20 °C has 915 kg/m^3 and 0.08 Pa s. The largest: 3.0 cm/s, Reynolds number 0.6.
SPEED_BY_SQUARE = 915 * 9.81 / (3 * 0.08)
GAP_M = 0.0003  # to glass, surface and each other
LAYER_M = 0.003  # thickness of what gathers under the front while the bottle lies on its back
KNOTS = 11  # keyframes of a bubble that the shoulder draws in
RECORDING_S = 1.0
LOOKS = 22  # moments at which bubbles are looked at for touching
TRIES = 40


@dataclass(frozen=True)
class Bubble:
    """Radius (m) and way: times (n,) in s, places (n, 3) in m, in the bottle's frame."""

    radius: float
    times: np.ndarray
    places: np.ndarray

    def at(self, time_s: float) -> np.ndarray:
        """Place at a time (m)."""
        return np.array([np.interp(time_s, self.times, self.places[:, k]) for k in range(3)])


def bubbles(level: float, past: str, random: np.random.Generator) -> list[Bubble]:
    """All bubbles of the bottle, filled up to this height (m).

    ``past``: the bottle was `shaken`, and they are everywhere; or it lay on its back and was `stood_up`, and
    they are in a layer behind the front wall. They rise straight up, each at its own speed, and rest under
    the surface.
    """
    made: list[Bubble] = []
    ways = np.empty((COUNT[past], LOOKS, 3))  # of those that are made
    for _ in range(TRIES * COUNT[past]):
        if len(made) == COUNT[past]:
            break
        radius = float(random.triangular(DIAMETER_M[0], 0.6 * DIAMETER_M[1], DIAMETER_M[1])) / 2
        start = (_anywhere if past == "shaken" else _in_the_layer)(level, radius, random)
        bubble = Bubble(radius, *_way(start, level, radius, random))
        way = np.array([bubble.at(time) for time in np.linspace(0, RECORDING_S, LOOKS)])
        near = radius + np.array([other.radius for other in made]) + GAP_M
        if not _meets(way, ways[: len(made)], near):
            ways[len(made)] = way
            made.append(bubble)
    return made


def _anywhere(level: float, radius: float, random: np.random.Generator) -> np.ndarray:
    """A place in the oil; one above its surface is that of a bubble that has come to rest under it."""
    room = _room(SHOULDER, radius)
    x, z = random.uniform(-room, room, 2)
    return np.array([x, random.uniform(BASE + radius + GAP_M, level + 0.008), z])


def _in_the_layer(level: float, radius: float, random: np.random.Generator) -> np.ndarray:
    """A place just behind the clear part of the front wall, or below it."""
    room = _room(SHOULDER, radius)
    x, depth = random.uniform(-0.8, 0.8) * room, min(random.exponential(LAYER_M / 3), LAYER_M)
    return np.array([x, random.uniform(PANE[0] - 0.016, PANE[1] - 0.004), room - depth])


def _way(start: np.ndarray, level: float, radius: float, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Times and places of a rise at even speed, drawn in where the shoulder begins; never through glass."""
    top, speed = level - radius - GAP_M, SPEED_BY_SQUARE * radius**2
    turn, out = random.uniform(0, 2 * np.pi), _room(level, radius) * np.sqrt(random.random())
    end = out * np.array([np.cos(turn), np.sin(turn)])
    times = np.linspace(0, RECORDING_S, KNOTS)
    arrival = (top - start[1]) / speed
    if 0 < arrival < RECORDING_S:
        times = np.sort(np.append(times, arrival))
    height = np.minimum(start[1] + speed * times, top)
    bend = np.clip((height - SHOULDER + 0.004) / (top - SHOULDER + 0.004), 0, 1)
    bend = (bend * bend * (3 - 2 * bend))[:, None]
    place = start[[0, 2]] * (1 - bend) + end * bend
    reach = _room(height, radius)[:, None]
    away = np.maximum(np.linalg.norm(place, axis=1, keepdims=True), 1e-12)
    # The body is square, the neck round: half way up the shoulder a circle is inside both.
    in_neck = height[:, None] > (SHOULDER + top) / 2
    place = np.where(in_neck, place * np.minimum(1, reach / away), np.clip(place, -reach, reach))
    places = np.stack([place[:, 0], height, place[:, 1]], axis=1)
    if not bend.any():  # straight: the ends say it all
        return times[[0, -1]], places[[0, -1]]
    return times, places


def _room(height: np.ndarray | float, radius: float) -> np.ndarray:
    return room_inside(height) - radius - GAP_M


def _meets(way: np.ndarray, others: np.ndarray, near: np.ndarray) -> bool:
    """Whether a bubble touches one of the others within the recording, or rises through it.

    way : (LOOKS, 3), others : (bubble, LOOKS, 3), places in m; near : (bubble,), distance (m) at which they
    touch.
    """
    apart, near = way - others, near[:, None]
    aside = np.hypot(apart[..., 0], apart[..., 2]) < near
    passing = np.diff(np.sign(apart[..., 1]), axis=1) != 0
    return bool((np.linalg.norm(apart, axis=2) < near).any() or (passing & aside[:, 1:]).any())
