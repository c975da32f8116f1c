"""A laid table: a matt menu card, and round it, nearer and farther, metal that glints under small lamps.

World frame: metres, x right, y up, z towards the camera; the cloth is y = 0, the lens 0.5 m before z = 0.
"""

from __future__ import annotations

from typing import Any

import cutlery
import mitsuba as mi
import numpy as np
import surfaces
from meshes import Body, faceted_ball, grid, joined, mesh, turned

EYE, AIM = np.array([0.0, 0.08, 0.5]), np.array([0.0, 0.018, 0.0])
# Azimuth from the family's (rad), W of the visible band, share of the samples: most go where the card is lit.
LAMPS = ((-0.30, 1.5, 8.0), (0.36, 1.5, 8.0), (2.55, 0.5, 2.0), (-2.70, 0.5, 2.0))
BULB_M, BULB = 0.005, 5.0  # radius, W m^-2 sr^-1: frosted
CARD_TILT_DEG = -9.0  # it leans back


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng(int(params["seed"]))
    rough = float(params["roughness"])
    along = (AIM - EYE) / np.linalg.norm(AIM - EYE)
    depth = float((EYE + float(params["distance_m"]) * along)[2])  # z of the card's middle
    steel = surfaces.metal("steel", surfaces.handled(rough, random))
    silver = surfaces.metal("silver", surfaces.handled(rough, random))
    brass = surfaces.metal("brass", surfaces.handled(1.3 * rough, random))
    brushed = surfaces.metal("steel", 0.30, across=0.10)
    floor = np.array([[(-0.7, 0, -1.0), (0.7, 0, -1.0)], [(-0.7, 0, 0.4), (0.7, 0, 0.4)]])
    scene: dict[str, Any] = {
        "cloth": mesh("cloth", grid(floor), surfaces.linen(random), smooth=False),
        "card": mesh(
            "card", _card(depth, float(params["yaw_deg"])), surfaces.card(float(params["ink"]), random)
        ),
        "room": surfaces.room(random),
    }
    for name, made, bsdf in (
        ("cutlery", _cutlery(depth, random), steel),
        ("cups", _cups(depth, random), silver),
        ("rings", _rings(depth, random), brass),
        ("tray", _tray(depth), brushed),
    ):
        scene[name] = mesh(name, made, bsdf)
    beads = surfaces.metal("silver", 0.12)
    scene["beads"] = mesh("beads", _beads(depth, random), beads, smooth=False)
    return scene | _lamps(params) | _bulbs(random)


def _card(depth: float, yaw_deg: float) -> Body:
    """The printed front, its foot on the cloth; the coordinates are 0..1 from the lower left."""
    w, h = surfaces.CARD_M[0] / 2, surfaces.CARD_M[1]
    flat = grid(np.array([[(-w, 0.0, 0.0), (w, 0.0, 0.0)], [(-w, h, 0.0), (w, h, 0.0)]]))
    return flat.moved([0, 0.001, depth], yaw_deg=yaw_deg, pitch_deg=CARD_TILT_DEG)


def _cutlery(depth: float, random: np.random.Generator) -> Body:
    """Fork and spoons to both sides and in front of the card, more of them behind."""
    made = []
    for kind, x, z, yaw in (
        (cutlery.fork, -0.053, -0.085, 3),
        (cutlery.spoon, 0.056, -0.075, -5),
        (cutlery.knife, 0.070, -0.22, 9),
        (cutlery.spoon, -0.092, -0.27, 24),
        (cutlery.fork, 0.005, -0.36, -35),
    ):
        shift = [x + random.normal(0, 0.003), 0, depth + z + random.normal(0, 0.006)]
        made.append(kind().moved(shift, yaw_deg=yaw + float(random.normal(0, 2.5))))
    return joined(made)


def _cups(depth: float, random: np.random.Generator) -> Body:
    """A footed silver cup and a small beaker behind the card."""
    cup = turned(
        [
            (0.019, 0.0),
            (0.021, 0.0015),
            (0.012, 0.005),
            (0.004, 0.010),
            (0.0045, 0.018),
            (0.012, 0.024),
            (0.021, 0.036),
            (0.0235, 0.052),
            (0.023, 0.062),
            (0.0222, 0.062),
            (0.020, 0.038),
            (0.0, 0.028),
        ]
    )
    beaker = turned(
        [
            (0.0, 0.0005),
            (0.014, 0.0005),
            (0.0155, 0.003),
            (0.0165, 0.02),
            (0.018, 0.036),
            (0.0175, 0.036),
            (0.015, 0.006),
            (0.0, 0.004),
        ]
    )
    return joined(
        [
            cup.moved([-0.067 + random.normal(0, 0.004), 0, depth - 0.145]),
            beaker.moved([0.060 + random.normal(0, 0.004), 0, depth - 0.105]),
            cup.moved([0.110 + random.normal(0, 0.01), 0, depth - 0.40]),
        ]
    )


def _rings(depth: float, random: np.random.Generator) -> Body:
    """Napkin rings, lying and standing."""
    angle = np.linspace(0, 2 * np.pi, 13)[::-1]
    ring = turned(
        np.stack([0.019 + 0.0035 * np.cos(angle), 0.0035 + 0.0035 * np.sin(angle)], axis=1), steps=4
    )
    standing = ring.moved([0, 0.0225, 0], pitch_deg=90)
    return joined(
        [
            standing.moved(
                [-0.115 + random.normal(0, 0.004), 0, depth - 0.24], yaw_deg=float(random.uniform(-40, 40))
            ),
            ring.moved([0.040, 0, depth + 0.115]),
            ring.moved([-0.150, 0, depth - 0.38]),
        ]
    )


def _tray(depth: float) -> Body:
    """A brushed plate under the things to the left, with a rolled rim."""
    outline = [
        (0.0, 0.0012),
        (0.02, 0.0012),
        (0.040, 0.0012),
        (0.046, 0.003),
        (0.050, 0.0048),
        (0.051, 0.003),
    ]
    return turned(outline).moved([-0.085, 0, depth - 0.145])


def _beads(depth: float, random: np.random.Generator) -> Body:
    """A necklace of faceted beads, 3 mm to 5 mm, strewn in front of the card and away behind it."""
    ball, made = faceted_ball(7, 10), []
    for z, count, start in ((0.085, 30, -0.070), (-0.055, 14, 0.036), (-0.30, 44, -0.12)):
        bend, wave = random.uniform(0, 6), random.uniform(0.006, 0.011)
        x = start
        for _ in range(count):
            r = float(random.uniform(0.0016, 0.0026))
            turn = np.linalg.qr(random.normal(0, 1, (3, 3)))[0]
            turn *= np.linalg.det(turn)
            place = np.array([x, r, depth + z + wave * np.sin(90 * x + bend)])
            made.append(Body(r * ball.vertices @ turn.T + place, ball.triangles, ball.uv))
            x += 2.05 * r
    return joined(made)


def _lamps(params: dict[str, Any]) -> dict[str, Any]:
    """Four small lamps round the table: two light the card, two beyond it glint on what lies flat."""
    radius, turn = float(params["lamp_mm"]) * 1e-3, np.radians(float(params["lamp_azimuth_deg"]))
    made = {}
    for k, (aside, power, share) in enumerate(LAMPS):
        a = turn + aside
        origin = [0.62 * np.sin(a), 0.55 + 0.02 * k, 0.62 * np.cos(a)]
        pose = mi.ScalarTransform4f().look_at(origin=origin, target=[0, 0.01, 0], up=[0, 1, 0])
        made[f"lamp_{k}"] = {
            "type": "disk",
            "to_world": pose @ mi.ScalarTransform4f().scale(radius),
            "bsdf": {"type": "diffuse", "reflectance": 0.0},
            "emitter": {
                "type": "area",
                "radiance": power / (np.pi * radius) ** 2,
                "sampling_weight": share,
            },
        }
    return made


def _bulbs(random: np.random.Generator) -> dict[str, Any]:
    """A string of frosted lights that lies on the cloth far behind."""
    made = {}
    for k, (x, z) in enumerate(((-0.13, -0.72), (-0.10, -0.55), (0.12, -0.80), (0.115, -0.60))):
        centre = [x + float(random.normal(0, 0.005)), BULB_M, z + float(random.normal(0, 0.03))]
        made[f"bulb_{k}"] = {
            "type": "sphere",
            "center": centre,
            "radius": BULB_M,
            "bsdf": {"type": "diffuse", "reflectance": 0.5},
            "emitter": {"type": "area", "radiance": BULB, "sampling_weight": 0.2},
        }
    return made
