"""The fan: guard, rotor, and what stands still behind and under them; metres.

Its own frame has the axle along z, towards the lens, and the face of the guard at z = 0.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import mitsuba as mi
import numpy as np
import prints
from meshes import Body, grid, joined, lacquer, mesh, ring, rod, satin, seen_from_front, turned

# Faces of guards: radii of the inner hoops, struts, wire, and tone of its lacquer.
FACES = {
    "guard": ((0.0115, 0.0180, 0.0245, 0.0310, 0.0375), 10, 0.0013, 0.45),
    "blades": ((0.0115, 0.0210, 0.0320), 6, 0.0008, 0.20),  # through which more of the blades is seen
}
GUARD_R, GUARD_DEEP, WIRE, RIM_WIRE = 0.0445, 0.044, 0.0011, 0.0020
HUB_R, TIP_R, BLADE_Z = 0.0130, 0.0400, -0.030
STEP_M = 0.0004  # between the vertices of a wire, which carry its worn paint


def _paint(length: float, random: np.random.Generator, tone: float) -> np.ndarray:
    """Worn lacquer along a wire: chips down to dark iron, dust, and a slow change of tone."""
    count = max(int(length / STEP_M), 6) + 1
    knots = np.arange(0, count + 30, 30)  # 12 mm apart
    slow = np.interp(np.arange(count), knots, random.uniform(-1, 1, knots.size))
    fine = random.uniform(-1, 1, count)
    chips = np.convolve(random.random(count) < 0.03, np.ones(3), mode="same") > 0
    out = np.where(chips, 0.07, tone * (1 + 0.2 * slow + 0.25 * fine))
    out[-1] = out[0]
    return np.clip(out, 0.03, 0.85)


def guard(params: dict[str, Any], random: np.random.Generator, pose: Any) -> tuple[Any, Any]:
    """The face of the guard: hoops on struts about the maker's badge, all within 2 mm of one plane."""
    hoops, struts, wire, tone = FACES[params["target"]]
    wires = [ring(r, 0.0, wire, _paint(2 * np.pi * r, random, tone)) for r in hoops]
    wires.append(ring(GUARD_R, -0.0004, RIM_WIRE, _paint(2 * np.pi * GUARD_R, random, tone)))
    for k in range(struts):
        along = np.linspace(0.0105, GUARD_R, int((GUARD_R - 0.0105) / STEP_M) + 1)
        turn = 2 * np.pi * (k + 0.35) / struts + 0.25 * (along / GUARD_R) ** 2
        path = np.stack([along * np.cos(turn), along * np.sin(turn), 0 * along - wire], axis=1)
        wires.append(rod(path, wire, _paint(along[-1] - along[0], random, tone)[: len(path)]))
    plate = turned([(0, 0.0014), (0.0085, 0.0013), (0.0105, 0.0005), (0.0109, -0.0008)])
    badge = seen_from_front(plate, prints.BADGE_MM * 1e-3)
    return ((joined(wires), lacquer(0.4), pose), (badge, satin(prints.badge(random), 0.25), pose))


def rotor(params: dict[str, Any], random: np.random.Generator, pose: Any) -> tuple[Any, Any]:
    """Blades and the domed cap of their hub, in one picture seen along the axle."""
    count = params["blades"]
    picture = satin(prints.rotor(count, random), 0.3)
    blades = joined([_blade(count, k) for k in range(count)])
    cap = turned(
        [(0, -0.0165), (0.006, -0.0168), (0.0105, -0.0178), (0.0125, -0.0195), (0.013, -0.022), (0.013, -0.034)]
    )
    size = prints.ROTOR_MM * 1e-3
    placed = pose @ mi.ScalarTransform4f().rotate([0, 0, 1], params["phase_deg"])
    return (seen_from_front(blades, size), picture, placed), (seen_from_front(cap, size), picture, placed)


def _blade(count: int, k: int) -> Body:
    """A twisted, swept blade: its chord comes forward from the leading edge, less steeply at the tip."""
    share = np.linspace(0, 1, 40)[:, None]
    radius = (HUB_R - 0.0008) + (TIP_R - HUB_R) * share
    s = np.linspace(-0.5, 0.5, 28)[None, :]  # 0.5: the leading edge
    rounded = np.clip(1 - np.clip((share - 0.72) / 0.2801, 0, 1) ** 2.2, 0, 1) ** 0.5
    width = 2 * np.pi / count * (0.56 + 0.22 * share) * rounded
    angle = 2 * np.pi * k / count + s * width + 0.10 * (share - 0.5)
    pitch = np.radians(34 - 16 * share)
    z = BLADE_Z - s * width * radius * np.tan(pitch) * 0.55 - 0.0012 * (2 * s) ** 2
    return grid(np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=2))


def stand(random: np.random.Generator, pose: Any, drop: float) -> dict[str, Any]:
    """What stands still behind the blades and under them: cage, rear guard, motor, neck, foot, cable."""
    wires = [ring(GUARD_R, -GUARD_DEEP, RIM_WIRE, _paint(2 * np.pi * GUARD_R, random, 0.16))]
    wires += [ring(r, -GUARD_DEEP - 0.002, WIRE, _paint(2 * np.pi * r, random, 0.12)) for r in (0.022, 0.033)]
    wires.append(ring(GUARD_R, -GUARD_DEEP / 2, WIRE, _paint(2 * np.pi * GUARD_R, random, 0.16)))
    for k in range(20):
        turn = 2 * np.pi * k / 20 + 0.1
        out = np.array([np.cos(turn), np.sin(turn), 0.0])
        knees = [out * GUARD_R, out * GUARD_R - [0, 0, GUARD_DEEP], out * 0.016 - [0, 0, GUARD_DEEP + 0.004]]
        for start, stop in pairwise(knees):
            path = start + np.linspace(0, 1, 60)[:, None] * (stop - start)
            wires.append(rod(path, WIRE, _paint(1.0, random, 0.16)[:60]))
    motor = turned([(0, -0.040), (0.017, -0.041), (0.018, -0.045), (0.018, -0.070), (0.012, -0.076), (0, -0.077)])
    foot = turned([(0, 0.0105), (0.008, 0.0105), (0.026, 0.0080), (0.0335, 0.0050), (0.0345, 0.0)], axis=1, around=120)
    neck = turned([(0.0052, 0.006), (0.0046, 0.012), (0.0046, drop - 0.012)], axis=1, around=40)
    below = pose @ mi.ScalarTransform4f().translate([0, -drop, -0.048])
    return {
        "cage": mesh("cage", joined(wires), lacquer(0.4), pose),
        "motor": mesh("motor", motor, satin(0.16, 0.3), pose),
        "foot": mesh("foot", foot, satin(0.5, 0.25), below),
        "neck": mesh("neck", neck, satin(0.30, 0.25), below),
    }
