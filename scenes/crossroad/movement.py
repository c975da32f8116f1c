"""The meshes of cars and walkers, and their keyframes: wheels roll, limbs swing; life-size metres."""

from __future__ import annotations

from typing import Any

import cars
import mitsuba as mi
import numpy as np
import paintwork
import walkers
from meshes import Body, glossy, joined, matte, mesh, toned
from traffic import Mover

LIMBS = ("a", "b", "c", "d")  # wheels, or legs and arms
LAST_S = 1.0  # a recording


def shapes(crowd: list[Mover], distance: float) -> dict[str, Any]:
    """The meshes of all, as they stand half way through the recording; those who stand still are joined."""
    ground = matte()
    driven = [m for m in crowd if m.kind != "walker"]
    skins = [paintwork.skin(cars.KINDS[m.kind], _paint(m), np.random.default_rng(m.seed)) for m in driven]
    picture, shells = paintwork.paint_shop(skins, [cars.shell(cars.KINDS[m.kind]) for m in driven])
    paint = mi.load_dict(glossy(picture, alpha=0.12))
    made, parked, waiting = {}, [], []
    for mover, shell in zip(driven, shells, strict=True):
        if mover.speed:
            made[f"{mover.name}_shell"] = mesh(
                f"{mover.name}_shell", _placed(mover, "shell", shell, distance), paint, smooth=True
            )
        else:
            parked.append(_placed(mover, "shell", shell, distance))
    made["parked"] = mesh("parked", joined(parked), paint, smooth=True)
    for mover in crowd:
        for part, what in _parts(mover).items():
            placed = toned(_placed(mover, part, what, distance))
            if mover.speed:
                name = f"{mover.name}_{part}"
                made[name] = mesh(name, placed, ground, smooth=mover.kind == "walker")
            else:
                waiting.append(placed)
    return made | {"waiting": mesh("waiting", joined(waiting), ground, smooth=True)}


def _paint(mover: Mover) -> float:
    tones = (0.03, 0.10, 0.22, 0.36, 0.55, 0.72)
    return float(np.random.default_rng([mover.seed, 1]).choice(tones[2:] if mover.name == "target" else tones))


def _placed(mover: Mover, part: str, what: Body, distance: float) -> Body:
    place = np.array([mover.x, mover.y, mover.z - distance])
    return what.moved(place + _turned(mover, _joint(mover, part)), mover.heading_deg)


def _parts(mover: Mover) -> dict[str, Body]:
    """The matte parts of a mover, each about its joint; only the target has all its limbs apart."""
    if mover.kind == "walker":
        parts = _walker_parts(mover)
    else:
        kind = cars.KINDS[mover.kind]
        parts = {"trim": cars.trim(kind)} | dict.fromkeys(LIMBS, cars.wheel(kind))
    if mover.name == "target":
        return parts
    first = next(iter(parts))
    joints = {part: _joint(mover, part) for part in parts}
    host = {"shell": "shell", "trim": first, "a": "a", "b": "b", "c": first, "d": first}
    if mover.kind != "walker":
        host |= {"b": "a", "c": "c", "d": "c"}
    merged: dict[str, list[Body]] = {}
    for part, what in parts.items():
        merged.setdefault(host[part], []).append(what.moved(joints[part] - joints[host[part]]))
    return {part: joined(bodies) for part, bodies in merged.items()}


def _person(mover: Mover) -> tuple[walkers.Person, np.random.Generator]:
    random = np.random.default_rng(mover.seed)
    return walkers.drawn(random), random


def _walker_parts(mover: Mover) -> dict[str, Body]:
    person, random = _person(mover)
    knee = 14.0 if mover.speed else 2.0
    elbow = float(random.uniform(15, 70))
    return {
        "shell": walkers.torso(person, random),
        "trim": walkers.luggage(person),
        "a": walkers.leg(person, 1, knee),
        "b": walkers.leg(person, -1, knee),
        "c": walkers.arm(person, 1, elbow),
        "d": walkers.arm(person, -1, elbow),
    }


def _joint(mover: Mover, part: str) -> np.ndarray:
    """Where a part's own origin lies in the mover, before it is turned: axle, hip or shoulder."""
    if part not in LIMBS:
        return np.zeros(3)
    if mover.kind == "walker":
        high = walkers.HIP if part in "ab" else walkers.SHOULDER
        return np.array([0.0, high * _person(mover)[0].scale, 0.0])
    kind = cars.KINDS[mover.kind]
    side = 1 if part in "ac" else -1
    return np.array([kind.axles[part in "ab"], kind.wheel, side * (kind.width / 2 - 0.082)])


def _turned(mover: Mover, point: np.ndarray) -> np.ndarray:
    aside = np.cross(mover.forward, [0.0, 1.0, 0.0])
    return point[0] * mover.forward + point[1] * np.array([0.0, 1.0, 0.0]) + point[2] * aside


def motions(mover: Mover, distance: float, unit_m: float) -> dict[str, Any]:
    """Keyframes of one mover's parts, in metres of the model (``unit_m`` of them to a life-size metre)."""
    if mover.speed == 0:
        return {}
    place = np.array([mover.x, mover.y, mover.z - distance])
    axis = np.cross([0.0, 1.0, 0.0], mover.forward).tolist()
    words = {}
    for part in {"shell", *_parts(mover)}:
        centre = place + _turned(mover, _joint(mover, part))
        times = np.linspace(0, LAST_S, 2 if part not in LIMBS or mover.kind != "walker" else 17)
        turn = _angle(mover, part, times)
        frames = [
            {
                "time_s": float(t),
                "translate_m": ((t - LAST_S / 2) * mover.speed * unit_m * mover.forward).tolist(),
                "rotate_deg": float(angle),
            }
            for t, angle in zip(times, turn, strict=True)
        ]
        words[f"{mover.name}_{part}"] = {"axis": axis, "centre_m": (centre * unit_m).tolist(), "keyframes": frames}
    return words


def _angle(mover: Mover, part: str, times: np.ndarray) -> np.ndarray:
    """Degrees that a part is turned about its axle or joint: wheels roll, limbs swing two by two."""
    if part not in LIMBS:
        return 0.0 * times
    if mover.kind != "walker":
        return np.degrees((times - LAST_S / 2) * mover.speed / cars.KINDS[mover.kind].wheel)
    person, random = _person(mover)
    half_cycle = 2 * np.sin(np.radians(person.step_deg)) * walkers.HIP * person.scale
    phase = np.pi * mover.speed * times / half_cycle + random.uniform(0, 2 * np.pi)
    swing = person.step_deg * (1 if part in "ad" else -1) * (1 if part in "ab" else 0.7)
    return swing * np.sin(phase)
