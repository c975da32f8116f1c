"""Who is on the road, where they are half way through a recording, and how fast; life-size metres, seconds.

The streets are those of :mod:`town`: traffic keeps to the right.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cars
import numpy as np
from ground import KERB

AWAY, NEARER, RIGHT, LEFT = 90.0, -90.0, 0.0, 180.0  # headings


@dataclass(frozen=True)
class Mover:
    """Somebody at (x, z) at the middle of the recording, heading so many degrees from +x towards -z."""

    name: str
    kind: str  # of a car, or walker
    x: float
    z: float
    heading_deg: float
    speed: float
    seed: int
    y: float = 0.0

    @property
    def forward(self) -> np.ndarray:
        turn = np.radians(self.heading_deg)
        return np.array([np.cos(turn), 0.0, -np.sin(turn)])

    @property
    def half_width(self) -> float:
        """Half of what it takes up across the picture in a recording."""
        across = abs(float(self.forward[0]))
        long = 0.3 if self.kind == "walker" else cars.KINDS[self.kind].length / 2
        return 0.3 + (0.6 if self.kind != "walker" else 0.0) + across * (long + 0.5 * self.speed)


def movers(params: dict[str, Any], distance: float) -> list[Mover]:
    """The target first, then everybody else who does not hide it."""
    random = np.random.default_rng([int(params["seed"]), 2])
    pace = float(params["pace"])
    target = _target(params["target"], params["path"], pace, random)
    others = _other_cars(target, pace, random) + _other_walkers(random)
    return [target, *[m for m in others if not _in_the_way(m, target, distance)]]


def _in_the_way(other: Mover, target: Mover, distance: float) -> bool:
    """Whether it stands or comes between the camera and the target, or would run into it."""
    u, far = distance - other.z, distance - target.z
    aside = abs(other.x / u - target.x / far) * far
    nearer = u < far and aside < target.half_width + other.half_width * far / u
    near = np.hypot(other.x - target.x, other.z - target.z) < 0.5 + 0.5 * (other.half_width + target.half_width)
    return bool(nearer or near)


def _target(kind: str, path: str, pace: float, random: np.random.Generator) -> Mover:
    seed = int(random.integers(1 << 30))
    aside, along, coin = (float(random.uniform(-1, 1)) for _ in range(3))
    if kind == "car":
        model = str(random.choice(["hatchback", "saloon", "estate"]))
        if path == "depth":
            return Mover("target", model, 2.0, -10.8 + 0.6 * along, NEARER, 4.0 * pace, seed)
        if coin < 0:
            return Mover("target", model, 0.1 + 0.7 * aside, -1.75, LEFT, 3.5 * pace, seed)
        return Mover("target", model, -0.1 + 0.7 * aside, 1.75, RIGHT, 3.5 * pace, seed)
    if path == "depth":
        return Mover(
            "target", "walker", -4.2 + 0.3 * aside, 0.9 + 0.8 * along, AWAY if coin < 0 else NEARER, 1.6 * pace, seed
        )
    way = RIGHT if coin < 0 else LEFT
    return Mover("target", "walker", 1.3 * aside, 5.9 + 0.5 * along, way, 1.4 * pace, seed, KERB)


def _other_cars(target: Mover, pace: float, random: np.random.Generator) -> list[Mover]:
    models = list(cars.KINDS)

    def car(name: str, x: float, z: float, heading: float, speed: float = 0.0) -> Mover:
        return Mover(name, str(random.choice(models)), x, z, heading, speed, int(random.integers(1 << 30)))

    made = [
        car("car_left", -0.4, -17.0 + random.uniform(-1, 1), NEARER),
        car("car_left_next", -0.4, -30.0 + random.uniform(-2, 2), NEARER),
        car("car_left_far", -0.4, -62.0, NEARER),
        car("car_right", 6.95, -19.0 + random.uniform(-1, 1), AWAY),
        car("car_right_next", 6.95, -25.6 + random.uniform(-0.4, 0.4), AWAY),
        car("car_right_far", 6.95, -47.0, AWAY),
        car("car_away", 5.0, -33.0 + random.uniform(-4, 4), AWAY, 4.0 * pace),
        car("car_waiting", 2.0, -11.6 + random.uniform(-0.8, 0), NEARER),
    ]
    if target.kind == "walker":
        made.append(car("car_other", random.uniform(0.5, 3.0), -1.75, LEFT, 0.0 if target.z < 3 else 2.5 * pace))
    elif target.z == -1.75:  # the other lane, on its way out of the picture
        made.append(car("car_other", 6.6, 1.75, RIGHT, 2.5 * pace))
    else:
        made.append(car("car_other", -6.8, -1.75, LEFT, 2.5 * pace))
    return made


def _other_walkers(random: np.random.Generator) -> list[Mover]:
    places = [
        (2.6, -6.9, 0, 1.3, 0), (5.2, -7.3, 180, 1.2, 0),
        (-5.3, -5.0, 0, 1.1, KERB), (-4.3, -5.4, 180, 1.4, KERB),
        (-2.5, -14.0, -90, 1.2, KERB), (9.0, -16.0, 90, 1.3, KERB), (8.8, -12.5, -90, 1.2, KERB),
        (-2.6, -27.0, 90, 1.3, KERB), (9.0, -38.0, -90, 1.2, KERB), (-4.8, 4.6, 90, 0, KERB),
        (4.2, 5.4, 160, 0, KERB), (-3.1, 10.3, 20, 0, KERB),
    ]  # fmt: skip
    made = []
    for number, (x, z, heading, speed, y) in enumerate(places):
        at = (x + float(random.uniform(-0.5, 0.5)), z + float(random.uniform(-0.3, 0.3)))
        turn, seed = heading + float(random.uniform(-8, 8)), int(random.integers(1 << 30))
        made.append(Mover(f"walker_{number}", "walker", *at, turn, speed, seed, y))
    return made
