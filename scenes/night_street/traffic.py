"""Cars with their lamps, parked and on their way, and people under umbrellas; metres, noses towards +x."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np
from meshes import Body, box, grid, joined, tube, turned

# Side view from tail to nose: x, height of the outline. The glass lies above BELT between FEET.
OUTLINE = np.array([
    (-2.15, 0.62), (-2.10, 0.96), (-1.85, 1.08), (-1.50, 1.16), (-0.95, 1.40), (-0.30, 1.47), (0.25, 1.45),
    (0.60, 1.34), (1.15, 1.00), (1.70, 0.89), (2.02, 0.76), (2.13, 0.62), (2.15, 0.50),
])  # fmt: skip
WIDE_M, BELT, FEET = 1.78, 0.96, (-1.66, 1.18)
HEAD_M, TAIL_M = 0.085, 0.060  # radii of the lamps


@dataclass(frozen=True)
class Car:
    """A car at (x, z), its nose so many degrees from +x towards -z; lit lamps: 'head', 'tail' or 'none'."""

    name: str
    x: float
    z: float
    heading_deg: float
    lit: str
    paint: float


def cars(random: np.random.Generator) -> list[Car]:
    """Two cars come, two go, one follows behind the camera, others are parked at the left kerb."""
    paint = [float(p) for p in random.choice([0.03, 0.06, 0.15, 0.35, 0.6], 8)]
    made = [
        Car("car_0", -4.35, -68.0 + random.uniform(-4, 3), -90.0, "head", paint[0]),
        Car("car_1", -4.25, -92.0 + random.uniform(-3, 6), -90.0, "head", paint[1]),
        Car("car_2", -1.75, -43.0 + random.uniform(-2.5, 2.5), 90.0, "tail", paint[2]),
        Car("car_3", -1.85, -60.0 + random.uniform(-4, 4), 90.0, "tail", paint[3]),
        Car("car_4", -1.80, 15.0, 90.0, "head", paint[7]),
    ]
    for k, z in enumerate((-74.0, -81.0, -88.5)):
        made.append(Car(f"parked_{k}", -5.1, z, -90.0, "none", paint[4 + k]))
    return made


def body(car: Car) -> Body:
    """Shell with darker glass, all in tones."""
    half = OUTLINE[-1, 0]
    x = -half * np.cos(np.linspace(0, np.pi, 34))
    top = np.interp(x, *OUTLINE.T)
    end = 1 - np.abs(x) / half
    wide = WIDE_M / 2 * (1 - 0.25 * np.exp(-end / 0.05) - 0.05 * np.exp(-end / 0.25))
    house = np.clip((top - BELT) / 0.45, 0, 1)
    shoulder = np.minimum(BELT, top - 0.05)
    z = np.stack([0.85 * wide, wide, wide, 0.97 * wide, wide * (0.92 - 0.16 * house), 0.5 * wide, 0 * x], 1)
    y = np.stack(
        [0 * x + 0.2, 0 * x + 0.27, 0.5 * (0.27 + shoulder), shoulder, top - 0.05 * (1 + house), top - 0.008, top], 1
    )
    left = np.stack([np.broadcast_to(x[:, None], z.shape), y, z], axis=2)
    ring = np.concatenate([left, left[:, -2::-1] * [1, 1, -1], left[:, :1]], axis=1)
    caps = [np.repeat(ring[i : i + 1].mean(axis=1, keepdims=True), ring.shape[1], 1) for i in (0, -1)]
    made = grid(np.concatenate([caps[0], ring, caps[1]]), tone=car.paint)
    middle = made.vertices[made.triangles].mean(axis=1)
    roof = np.interp(middle[:, 0], *OUTLINE.T) - 0.10
    side = np.abs(middle[:, 2]) > 0.62 * WIDE_M / 2
    inside = (middle[:, 0] > FEET[0] + 0.1) & (middle[:, 0] < FEET[1] - 0.1) & (middle[:, 1] > BELT)
    screens = inside & ~side & ((middle[:, 0] > 0.42) | (middle[:, 0] < -0.85))
    glass = (inside & side & (middle[:, 1] < roof)) | screens
    dark = made.uv.copy()
    dark[:, 0] = 0.02
    count = len(made.vertices)
    shell = Body(
        np.tile(made.vertices, (2, 1)), made.triangles + count * glass[:, None], np.concatenate([made.uv, dark])
    )
    return joined([shell, *_fittings(half)]).moved((car.x, 0.0, car.z), car.heading_deg)


def _fittings(half: float) -> list[Body]:
    """Wheels, grille, plates and mirrors."""
    made = []
    for x in (-1.32, 1.36):
        for side in (-1, 1):
            rim = np.linspace(0, 2 * np.pi, 25)
            rings = [(0.0, 0.3), (0.20, 0.3), (0.205, 0.04), (0.31, 0.04)]
            face = np.array([[(x + r * np.cos(a), 0.31 + r * np.sin(a), side * 0.90) for a in rim] for r, _ in rings])
            made.append(grid(face, tone=[tone for _, tone in rings]))
            tread = np.array(
                [[(x + 0.31 * np.cos(a), 0.31 + 0.31 * np.sin(a), z) for a in rim] for z in (side * 0.9, side * 0.7)]
            )
            made.append(grid(tread, tone=0.03))
    made.append(box((half - 0.05, 0.46, -0.42), (half + 0.005, 0.58, 0.42), 0.03))
    for x in (-half - 0.01, half + 0.01):
        made.append(box((x - 0.01, 0.42 if x > 0 else 0.66, -0.26), (x + 0.01, 0.53 if x > 0 else 0.77, 0.26), 0.6))
    made += [box((0.75, 0.97, s * 0.97 - 0.1), (0.9, 1.1, s * 0.97 + 0.1), 0.03) for s in (-1, 1)]
    return made


def car_lamps(car: Car, head: float, tail: float) -> dict[str, Any]:
    """Two discs each, of these radiances (W m^-2 sr^-1)."""
    if car.lit == "none":
        return {}
    front = car.lit == "head"
    half, radius, radiance = OUTLINE[-1, 0], HEAD_M if front else TAIL_M, head if front else tail
    turn = mi.ScalarTransform4f().translate([car.x, 0, car.z]).rotate([0, 1, 0], car.heading_deg)
    made = {}
    for side, z in (("l", -0.62), ("r", 0.62)):
        at = [half + 0.02 if front else -half - 0.02, 0.66 if front else 0.86, z]
        aim = [at[0] + (1 if front else -1), at[1] - (0.06 if front else 0), z]
        pose = turn @ mi.ScalarTransform4f().look_at(origin=at, target=aim, up=[0, 1, 0])
        made[f"{car.name}_{side}"] = {
            "type": "disk",
            "to_world": pose @ mi.ScalarTransform4f().scale(radius),
            "bsdf": {"type": "diffuse", "reflectance": 0.0},
            "emitter": {"type": "area", "radiance": radiance},
        }
    return made


def people(random: np.random.Generator) -> list[Body]:
    """A few on the right pavement and crossing, most under umbrellas."""
    made = []
    for x, z in ((0.1, -31.0), (-0.2, -47.0), (0.35, -56.0), (-3.1, -78.0), (0.0, -72.0)):
        at = (x + float(random.uniform(-0.15, 0.15)), 0.1, z + float(random.uniform(-2, 2)))
        coat, legs = (float(t) for t in random.choice([0.03, 0.08, 0.2, 0.4], 2))
        parts = [
            turned(
                [(0.19, 0.75), (0.18, 0.95), (0.17, 1.15), (0.22, 1.35), (0.14, 1.46), (0.06, 1.5)],
                (0, 0, 0),
                tone=coat,
            ),
            turned([(0.0, 1.48), (0.08, 1.53), (0.10, 1.62), (0.085, 1.71), (0, 1.76)], (0, 0, 0), tone=0.3),
        ]
        stride = float(random.uniform(-0.2, 0.2))
        for s in (-1, 1):
            parts.append(
                tube(
                    [(s * 0.09, 0.85, 0), (s * 0.09, 0.45, 0.5 * s * stride), (s * 0.09, 0.0, s * stride)],
                    [0.09, 0.06, 0.05],
                    tone=legs,
                )
            )
            parts.append(tube([(s * 0.22, 1.38, 0), (s * 0.26, 1.1, 0.05), (s * 0.15, 1.15, 0.2)], 0.05, tone=coat))
        if random.random() < 0.75:
            parts.append(
                turned(
                    [(0.0, 2.12), (0.18, 2.09), (0.36, 2.00), (0.52, 1.84)],
                    (0.1, 0, 0),
                    around=8,
                    tone=float(random.choice([0.03, 0.12, 0.4])),
                )
            )
            parts.append(tube([(0.1, 1.1, 0.15), (0.1, 2.1, 0)], 0.008))
        made.append(joined(parts).moved(at, float(random.uniform(0, 360))))
    return made
