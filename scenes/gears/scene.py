"""A train of wheels that turns before a pearled plate: gilt brass and steel, under a lamp beside a window.

World frame: metres, x right, y up, z towards the lens, which stands at the origin and looks along -z. The
machine's own frame is in millimetres, the faces of the wheels at z = 0.
"""

from __future__ import annotations

from typing import Any

import finish
import mitsuba as mi
import numpy as np
from solids import Body, box, grid, joined, placed, turning
from surfaces import glossy, matte, mesh, panel, texture
from train import Wheel, train
from wheels import cock, pillar, screw, wheel_body

M_PER_MM = 1e-3
THICK_MM, BEHIND_MM, PLATE_MM, COCK_MM = 1.6, -5.5, -17.0, 6.5
GILT, STEEL, PLATE = 0.62, 0.36, 0.20  # reflectances: frosted gilding, phosphated steel, blackened brass
ROUGH = 0.34  # of the lacquer over them
WALL_M = -0.72
LAMP_AWAY_M, LAMP_M, LAMP_IRRADIANCE = (0.55, 0.40), (0.30, 0.30), 2.6  # aside, up; W m^-2 on the wheels
WINDOW_RADIANCE, ROOM_RADIANCE = 5.0, 0.22  # W m^-2 sr^-1


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1656, int(params["seed"])])
    wheels = train(params["module_mm"], random)
    scene: dict[str, Any] = {"type": "scene"}
    for k, wheel in enumerate(wheels):
        body = wheel_body(wheel, arms=int(random.choice([4, 5, 6])), thick_mm=THICK_MM)
        half = wheel.radius * (1 + 2.4 / wheel.teeth)
        worn = finish.turned_face(half, params["tarnish"], random)
        scene[f"wheel_{k}"] = _placed(f"wheel_{k}", _on(wheel, body, 0.0), params, _finished(k, worn))
    behind = wheels[0]._replace(radius=wheels[0].radius * 1.18)
    body = wheel_body(behind, arms=6, thick_mm=THICK_MM)
    worn = 0.5 * finish.turned_face(behind.radius * 1.05, params["tarnish"], random)
    scene["behind"] = _placed("behind", _on(behind, body, BEHIND_MM), params, _finished(1, worn))
    return scene | _frame(wheels, params, random) | _room(random) | _lights(params)


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """Every wheel turns evenly; none is turned half way through the second."""
    wheels = train(params["module_mm"], np.random.default_rng([1656, int(params["seed"])]))
    turn, shift = _pose(params)
    first = np.degrees(params["pitch_mm_per_s"] / wheels[0].radius)  # in a second
    found = {}
    for k, wheel in enumerate(wheels):
        half = float(first * wheel.ratio / 2)
        found[f"wheel_{k}"] = {
            "axis": turn[:, 2].tolist(),
            "centre_m": (turn @ [*(M_PER_MM * wheel.centre), 0.0] + shift).tolist(),
            "keyframes": [{"time_s": 0.0, "rotate_deg": -half}, {"time_s": 1.0, "rotate_deg": half}],
        }
    return found | {"behind": found["wheel_0"]}


def _pose(params: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and shift (m) from the machine to the world."""
    return turning([0, 1, 0], params["yaw_deg"]), np.array([0.0, 0.0, -params["distance_m"]])


def _on(wheel: Wheel, body: Body, z: float) -> Body:
    """The wheel turned so that it meshes, on its arbor."""
    return placed(body, [*wheel.centre, z], turn=turning([0, 0, 1], np.degrees(wheel.phase)))


def _placed(name: str, body: Body, params: dict[str, Any], bsdf: Any) -> mi.Mesh:
    turn, shift = _pose(params)
    return mesh(name, placed(body, shift, turn=turn, scale=M_PER_MM), bsdf, smooth=False)


def _finished(k: int, worn: np.ndarray) -> dict[str, Any]:
    return glossy(texture((STEEL if k in (1, 4) else GILT) * worn), ROUGH)


def _frame(wheels: list[Wheel], params: dict[str, Any], random: np.random.Generator) -> dict[str, Any]:
    """The pearled plate behind, its pillars and screws, a steel cock before the two last wheels."""
    w, h = 75.0, 50.0
    flat = grid([[(-w, -h, PLATE_MM), (w, -h, PLATE_MM)], [(-w, h, PLATE_MM), (w, h, PLATE_MM)]])
    plate = glossy(texture(PLATE * finish.pearled(2 * w, 2 * h, random)), ROUGH)
    free = [
        at
        for at in random.uniform(-1, 1, (60, 2)) * [52, 33]
        if all(np.hypot(*(at - wheel.centre)) > wheel.radius + 6 for wheel in wheels)
    ]
    posts = [at for k, at in enumerate(free) if all(np.hypot(*(at - b)) > 12 for b in free[:k])][:4]
    screws = [screw(at, 2.6, float(random.uniform(0, 180))) for at in posts]
    last = wheels[-1].centre
    away = last + 13.0 * np.array([np.cos(wheels[-1].phase), np.sin(wheels[-1].phase)])
    held = [screw(at, 1.7, float(random.uniform(0, 180))) for at in (last, away)]
    over = [placed(body, [0, 0, z]) for z, bodies in ((2.2, screws), (COCK_MM + 0.7, held)) for body in bodies]
    bar = joined([cock(last, away, COCK_MM), *over])
    posts_body = [pillar(at, PLATE_MM, 1.0) for at in posts]
    arbors = [placed(box([-0.9, -0.9, PLATE_MM], [0.9, 0.9, -0.5]), [*wheel.centre, 0]) for wheel in wheels]
    blued = glossy(texture(STEEL * finish.brushed((240, 240), params["tarnish"], random)), ROUGH)
    return {
        "plate": _placed("plate", flat, params, plate),
        "pillars": _placed("pillars", joined([*posts_body, *arbors]), params, glossy(STEEL, ROUGH)),
        "bars": _placed("bars", bar, params, blued),
    }


def _room(random: np.random.Generator) -> dict[str, Any]:
    back = mi.ScalarTransform4f().translate([0, 0, WALL_M]).scale([0.9, 0.6, 1])
    return {"wall": {"type": "rectangle", "to_world": back, "bsdf": matte(0.3)}}


def _lights(params: dict[str, Any]) -> dict[str, Any]:
    middle = np.array([0.0, 0.0, -params["distance_m"]])
    azimuth = np.radians(params["lamp_azimuth_deg"])
    aside, up = LAMP_AWAY_M
    away = np.array([aside * np.sin(azimuth), up, aside * np.cos(azimuth)])
    cosine = away[2] / np.linalg.norm(away)
    radiance = LAMP_IRRADIANCE * (away @ away) / (LAMP_M[0] * LAMP_M[1] * cosine)
    window = (-np.sign(params["lamp_azimuth_deg"]) * 0.75, 0.35, 0.25)
    return {
        "lamp": panel(middle + away, middle, LAMP_M, float(radiance)),
        "window": panel(window, middle, (0.7, 1.0), WINDOW_RADIANCE),
        "room": {"type": "constant", "radiance": ROOM_RADIANCE},
    }
