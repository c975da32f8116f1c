"""People: torso, head and limbs as tapered tubes with clothes; in metres, facing +x, feet on y = 0.

A limb is a body of its own, about its joint, so that it can swing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from meshes import Body, box, grid, joined, tube

HIP, SHOULDER = 0.93, 1.43  # heights of the joints of a person of 1.75 m
SKIN = 0.42


@dataclass(frozen=True)
class Person:
    """Shape and clothes; tones are reflectances."""

    height: float
    girth: float
    coat: float
    stripe: float
    legs: float
    shoes: float
    hair: float
    long_coat: bool
    hat: bool
    bag: str
    step_deg: float

    @property
    def scale(self) -> float:
        return self.height / 1.75


def drawn(random: np.random.Generator) -> Person:
    """Somebody, as chance has it."""
    coat = float(random.choice([0.06, 0.12, 0.25, 0.45, 0.60]))
    return Person(
        height=float(random.uniform(1.58, 1.88)),
        girth=float(random.uniform(0.92, 1.12)),
        coat=coat,
        stripe=float(random.choice([coat, coat, coat, 0.5 * coat, 0.6])),
        legs=float(random.choice([0.04, 0.08, 0.13, 0.30])),
        shoes=float(random.choice([0.03, 0.10, 0.60])),
        hair=float(random.choice([0.03, 0.06, 0.15, 0.30])),
        long_coat=bool(random.random() < 0.35),
        hat=bool(random.random() < 0.25),
        bag=str(random.choice(["none", "shoulder", "rucksack", "carrier"])),
        step_deg=float(random.uniform(18, 27)),
    )


def torso(person: Person, random: np.random.Generator) -> Body:
    """Trunk, neck, head with hair or hat: everything that does not swing."""
    hem = 0.55 if person.long_coat else 0.80
    y = np.array([hem, 0.86, 0.95, 1.06, 1.18, 1.30, 1.40, 1.46, 1.49, 1.52])
    wide = np.array([0.185, 0.185, 0.185, 0.165, 0.185, 0.205, 0.205, 0.15, 0.075, 0.06]) * person.girth
    deep = np.array([0.145, 0.135, 0.13, 0.115, 0.125, 0.135, 0.115, 0.09, 0.065, 0.06]) * person.girth
    wide[-2:], deep[-2:] = (0.068, 0.06), (0.07, 0.06)
    fine = np.linspace(hem, 1.52, 36)
    angle = np.linspace(0, 2 * np.pi, 23)
    folds = 1 + 0.035 * np.sin(7 * angle + 3 * random.random() + 9 * fine[:, None]) * (fine[:, None] < 1.42)
    x = 0.9 * np.interp(fine, y, deep)[:, None] * np.cos(angle) * folds
    z = np.interp(fine, y, wide)[:, None] * np.sin(angle) * folds
    tone = np.where((np.sin(fine * 2 * np.pi / 0.11) > 0.5) & (fine < 1.42), person.stripe, person.coat)
    tone = np.where(fine > 1.475, SKIN, tone)[:, None] * np.ones_like(angle)
    opening = (np.abs(angle[None, :] - np.pi) > np.pi - 0.25) & (fine[:, None] < 1.46)
    tone = np.where(opening, 0.5 * tone, tone)
    trunk = grid(np.stack([x, np.broadcast_to(fine[:, None], x.shape), z], axis=2), tone=tone)
    hips = _ellipsoid((0, 0.90, 0), (0.115, 0.13, 0.165), person.legs)
    return joined([trunk, hips, *_head(person)]).moved((0, 0, 0), scale=person.scale)


def _head(person: Person) -> list[Body]:
    head = _ellipsoid((0.025, 1.645, 0), (0.098, 0.118, 0.078), SKIN)
    parts = [head, _ellipsoid((0.122, 1.635, 0), (0.022, 0.022, 0.014), 0.8 * SKIN)]
    parts += [_ellipsoid((0.108, 1.668, s * 0.032), (0.014, 0.010, 0.016), 0.05) for s in (-1, 1)]
    parts += [_ellipsoid((0.108, 1.592, 0), (0.014, 0.009, 0.026), 0.5 * SKIN)]
    if person.hat:
        parts += [_ellipsoid((0.015, 1.70, 0), (0.11, 0.085, 0.092), person.coat)]
        parts += [_ellipsoid((0.06, 1.695, 0), (0.15, 0.012, 0.105), 0.8 * person.coat)]
    else:
        parts += [_ellipsoid((-0.005, 1.672, 0), (0.104, 0.108, 0.088), person.hair)]
    return parts


def luggage(person: Person) -> Body:
    """What the person carries; a scarf end where there is nothing."""
    if person.bag == "rucksack":
        made = [
            _ellipsoid((-0.20, 1.22, 0), (0.10, 0.24, 0.16), 0.16),
            box((-0.30, 1.10, -0.1), (-0.27, 1.22, 0.1), 0.5),
        ]
    elif person.bag == "shoulder":
        strap = [(0.02, 1.45, 0.12), (0.13, 1.25, 0.0), (0.10, 0.95, -0.2)]
        made = [box((-0.14, 0.78, -0.30), (0.16, 1.0, -0.21), 0.10), tube(strap, 0.018, tone=0.10, around=8)]
    elif person.bag == "carrier":
        made = [box((-0.10, 0.36, 0.25), (0.22, 0.70, 0.36), 0.62), box((-0.02, 0.46, 0.36), (0.14, 0.60, 0.365), 0.10)]
    else:
        made = [box((0.095, 1.20, 0.02), (0.135, 1.46, 0.10), 0.5)]
    return joined(made).moved((0, 0, 0), scale=person.scale)


def leg(person: Person, side: int, bend_deg: float) -> Body:
    """A leg about its hip joint, the knee bent by an angle; ``side`` is 1 or -1 along z."""
    bend = np.radians(bend_deg)
    knee = np.array([0.02, -0.44, 0])
    ankle = knee + 0.42 * np.array([-np.sin(bend), -np.cos(bend), 0])
    path = np.concatenate([np.linspace((0, 0.04, 0), knee, 7), np.linspace(knee, ankle, 7)[1:]])
    radius = np.interp(np.linspace(0, 1, 13), [0, 0.45, 0.55, 0.7, 1], [0.090, 0.062, 0.058, 0.060, 0.046])
    trousers = tube(path, radius * person.girth, tone=person.legs, around=14)
    toe = np.array([np.cos(bend), -np.sin(bend), 0])
    shoe = _ellipsoid(tuple(ankle + 0.07 * toe + [0, -0.035, 0]), (0.135, 0.05, 0.05), person.shoes)
    made = joined([trousers, shoe]).moved((0, 0, side * 0.095 * person.girth), scale=1.0)
    return made.moved((0, 0, 0), scale=person.scale)


def arm(person: Person, side: int, bend_deg: float) -> Body:
    """An arm about its shoulder joint, the elbow bent forwards by an angle."""
    bend = np.radians(bend_deg)
    elbow = np.array([-0.02, -0.29, side * 0.03])
    wrist = elbow + 0.25 * np.array([np.sin(bend), -np.cos(bend), 0])
    path = np.concatenate([np.linspace((0, 0.0, 0), elbow, 6), np.linspace(elbow, wrist, 5)[1:]])
    sleeve = tube(path, np.linspace(0.062, 0.04, 10) * person.girth, tone=person.coat, around=12)
    hand = _ellipsoid(tuple(wrist + (wrist - elbow) * 0.25), (0.035, 0.055, 0.025), SKIN)
    made = joined([sleeve, hand]).moved((0, 0, side * 0.225 * person.girth), scale=1.0)
    return made.moved((0, 0, 0), scale=person.scale)


def _ellipsoid(centre: tuple[float, float, float], radii: tuple[float, float, float], tone: float) -> Body:
    angle, turn = np.meshgrid(np.linspace(0, np.pi, 8), np.linspace(0, 2 * np.pi, 13), indexing="ij")
    unit = np.stack([np.sin(angle) * np.cos(turn), np.cos(angle), np.sin(angle) * np.sin(turn)], axis=2)
    return grid(unit * radii + np.asarray(centre), tone=tone)
