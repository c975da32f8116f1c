"""An apple tree in leaf and late blossom, seen from the grass: one branch in focus, others round it.

World frame: metres, x right, y up, z towards the camera; the grass is y = 0.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import branches
import flowers
import leaves
import mitsuba as mi
import numpy as np
import sky
from branches import Branch
from meshes import Body, joined, matte, mesh, quads, tube

EYE = np.array([0.0, 1.6, 0.0])
AXIS = np.array([0.0, 0.161, -1.0]) / np.hypot(0.161, 1.0)
UP = np.array([0.0, -AXIS[2], AXIS[1]])
RATE_HZ = (0.6, 1.1)  # at which branches sway
LAST_S = 1.0  # a recording


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([int(params["seed"]), 3])
    contrast = float(params["contrast"])
    skyline = _skyline(random)
    bark = matte()
    leaf = leaves.tissue(leaves.skin(random, contrast), through=0.9)
    white = leaves.tissue(flowers.skin(random, contrast), through=0.7, roughness=0.6)
    scene: dict[str, Any] = {
        "sun": sky.sun(float(params["sun_azimuth_deg"])),
        "sky": sky.dome(int(params["seed"])),
        "grass": _grass(),
        "far_leaves": mesh("far_leaves", _far_leaves(skyline, random), leaf),
        "hedge": mesh("hedge", _hedge(skyline, random), bark),
        "far_wood": mesh("far_wood", _far_wood(random), bark),
    }
    for name, branch in _branches(params).items():
        places, frames, sizes = branch.leaf_arrays()
        fine = 2 if name == "target" else 1
        wood = list(branch.wood)
        scene[f"{name}_leaves"] = mesh(f"{name}_leaves", leaves.grown(places, frames, sizes, random, fine=fine), leaf)
        if branch.flowers:
            petals, threads = flowers.blossoms(branch.flowers, random)
            scene[f"{name}_petals"] = mesh(f"{name}_petals", petals, white)
            wood.append(threads)
        scene[f"{name}_wood"] = mesh(f"{name}_wood", joined(wood), bark)
    return scene


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """Every branch sways about its foot, each in its own time."""
    random = np.random.default_rng([int(params["seed"]), 4])
    words = {}
    for name, branch in _branches(params).items():
        rate, phase = random.uniform(*RATE_HZ), random.uniform(0, 2 * np.pi)
        lean = random.normal(0, 0.25, 2)
        times = np.linspace(0, LAST_S, 21)
        angles = float(params["sway_deg"]) * np.sin(2 * np.pi * rate * times + phase)
        sway = {
            "axis": [float(lean[0]), float(lean[1]), 1.0],
            "centre_m": branch.foot.tolist(),
            "keyframes": [{"time_s": float(t), "rotate_deg": float(a)} for t, a in zip(times, angles, strict=True)],
        }
        words |= dict.fromkeys([f"{name}_{part}" for part in _parts(branch)], sway)
    return words


def _parts(branch: Branch) -> list[str]:
    return ["wood", "leaves", "petals"] if branch.flowers else ["wood", "leaves"]


def _at(x: float, y: float, depth: float) -> np.ndarray:
    """The place right of the axis by x, above it by y, at an axial depth (m)."""
    return EYE + depth * AXIS + y * UP + np.array([x, 0.0, 0.0])


def _branches(params: dict[str, Any]) -> dict[str, Branch]:
    """The target, others of its tree behind it, twigs near the camera in the corners of the picture."""
    random = np.random.default_rng([int(params["seed"]), 5])
    depth, side = float(params["distance_m"]), float(random.choice([-1.0, 1.0]))
    made = {"target": _target(params, depth, side, random)}
    for k, (x, y) in enumerate([(1, 1), (-1, 1), (1, -1)]):
        near = random.uniform(2.95, 3.6)
        foot = _at(side * x * (0.046 * near + 0.05), y * (0.018 * near + random.uniform(0.0, 0.05)), near)
        heading = np.array([-side * x, -0.2 * y + random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3)])
        made[f"near_{k}"] = branches.grow(foot, heading, random.uniform(0.12, 0.20), random, leaf_m=0.046)
    for k, behind in enumerate((1.3, 1.8, 2.4, 3.2, 4.3)):
        far = depth + behind + random.uniform(-0.15, 0.15)
        way = (-1) ** k * side
        foot = _at(-way * (0.050 * far + 0.03), random.uniform(-0.028, 0.020) * far, far)
        heading = np.array([way, random.uniform(-0.1, 0.5), random.uniform(-0.4, 0.4)])
        blooms = int(random.integers(0, 4)) if int(params["flowers"]) > 3 else 0
        made[f"behind_{k}"] = branches.grow(
            foot, heading, random.uniform(0.45, 0.75), random, flowers=blooms, thick_m=0.007
        )
    return made


def _target(params: dict[str, Any], depth: float, side: float, random: np.random.Generator) -> Branch:
    """The branch in focus, grown in from one side; its leaves lie half way up the picture."""
    rise, high = float(random.uniform(0.1, 0.4)), 0.0
    before = random.bit_generator.state
    for _ in range(2):  # a branch winds: grown once to see how high it gets, then the same at another foot
        random.bit_generator.state = before
        branch = branches.grow(
            _at(-0.27 * side, high, depth), np.array([side, rise, 0.0]), 0.44, random,
            flat=0.35, flowers=int(params["flowers"]), spur_m=0.027,
        )  # fmt: skip
        places = branch.leaf_arrays()[0]
        high -= float(((places - EYE) @ UP).mean())
    return branch


def _skyline(random: np.random.Generator) -> Callable[[np.ndarray], np.ndarray]:
    """How high the other trees reach above the axis (m) at x (m)."""
    one, other = random.uniform(0, 6, 2)
    return lambda x: 0.10 + 0.22 * np.sin(2.1 * x + one) + 0.12 * np.sin(5.3 * x + other)


def _hedge(skyline: Callable[[np.ndarray], np.ndarray], random: np.random.Generator) -> Body:
    """The dark inside of the crowns, 25 m away: little sky is seen through them."""
    x = np.linspace(-2.6, 2.6, 105)
    top = skyline(x) - 0.15 + 0.06 * random.standard_normal(x.size)
    rows = np.stack([[_at(*where, 25.0) for where in zip(x, y, strict=True)] for y in (top - 6.0, top)])
    uv = np.stack([np.broadcast_to(random.uniform(0.03, 0.09, x.size), rows.shape[:2]), 0.5 + 0 * rows[..., 0]], 2)
    return Body(rows.reshape(-1, 3), quads(*rows.shape[:2]), uv.reshape(-1, 2))


def _far_leaves(skyline: Callable[[np.ndarray], np.ndarray], random: np.random.Generator) -> Body:
    """Crowns of other trees, 16 m to 24 m away: tufts of leaves below a ragged skyline."""
    tufts, each = 230, 26
    x = random.uniform(-1.7, 1.7, tufts)
    y = skyline(x) - np.abs(random.normal(0, 0.55, tufts))
    depth = random.uniform(16, 24, tufts)
    middle = np.array([_at(*where) for where in zip(x, y, depth, strict=True)])
    places = np.repeat(middle, each, axis=0) + random.normal(0, 0.09, (tufts * each, 3))
    frames = np.linalg.qr(random.normal(0, 1, (len(places), 3, 3)))[0]
    return leaves.grown(places, frames, random.uniform(0.05, 0.09, len(places)), random, fine=0)


def _far_wood(random: np.random.Generator) -> Body:
    """Limbs of this tree and trunks of the others."""
    made = []
    for x, depth, thick in (
        (-0.33, 7.5, 0.045),
        (0.42, 8.8, 0.035),
        (-1.0, 17.0, 0.10),
        (0.7, 19.0, 0.12),
        (1.5, 21.0, 0.1),
    ):
        path = np.array(
            [_at(x + 0.05 * k * random.uniform(-1, 1), y, depth) for k, y in enumerate(np.linspace(-2.2, 2.2, 9))]
        )
        made.append(tube(path, np.linspace(thick, 0.6 * thick, 9), around=12, tone=0.12))
    return joined(made)


def _grass() -> dict[str, Any]:
    """Level ground; it is not seen, but lights the leaves from below."""
    flat = mi.ScalarTransform4f().rotate([1, 0, 0], -90).scale(120)
    return {"type": "rectangle", "to_world": flat, "bsdf": {"type": "diffuse", "reflectance": 0.10}}
