"""A populated circuit board under an inspection microscope, with a ring of lamps and one from the side.

World frame: millimetres, x right, y up in the picture, z towards the objective; the board lies
``height_um`` over the origin.
"""

from __future__ import annotations

from typing import Any

import board
import components
import mitsuba as mi
import numpy as np
from layout import BODY_MM, SIZE_MM, Layout, draw_layout
from solids import Body, grid, joined, placed, turning
from stroke_font import drawn, lines
from surfaces import cloudy, glossy, matte, mesh, noise, texture, tones

RING_MM, RING_RADIUS_MM, RING_LAMP_MM, RING_RADIANCE = 55.0, 26.0, 7.0, 95.0  # height, radius; W m^-2 sr^-1
SIDE_MM, SIDE_RADIUS_MM, SIDE_RADIANCE = (38.0, 30.0), 11.0, 40.0  # away, up
ROOM_RADIANCE = 0.9
MOVED = ("board", "pack", "leads", "ceramic", "tops", "caps", "values")


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (millimetres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1943, int(params["seed"])])
    layout = draw_layout(params["ic_mm"], random)
    half = np.array(SIZE_MM) / 2
    flat = grid([[(-half[0], -half[1], 0), (half[0], -half[1], 0)], [(-half[0], half[1], 0), (half[0], half[1], 0)]])
    picture = texture(board.face(layout, params["solder_mask"], random))
    parts = components.chips(layout)
    tin = glossy(texture(0.34 * (1 + 0.3 * cloudy((64, 64), 6, 3, random))), 0.3)
    return {
        "type": "scene",
        "board": _placed("board", flat, params, glossy(picture, params["gloss"])),
        "pack": _placed("pack", components.pack(layout.ic), params, glossy(texture(_moulding(random)), 0.4)),
        "leads": _placed("leads", components.leads(layout), params, tin),
        "ceramic": _placed("ceramic", parts["ceramic"], params, matte(tones())),
        "tops": _placed("tops", parts["tops"], params, glossy(0.035, 0.25)),
        "caps": _placed("caps", parts["caps"], params, tin),
        "values": _placed("values", _values(layout), params, matte(texture(_value_picture(layout)))),
        **_ring(),
        "side": _disc(_side(params["side_azimuth_deg"]), SIDE_RADIUS_MM, SIDE_RADIANCE),
        "room": {"type": "constant", "radiance": ROOM_RADIANCE},
    }


def motion(params: dict[str, Any]) -> dict[str, Any]:
    """The stage creeps along the board, a little unevenly; half way through it is where the card has it."""
    way, azimuth = params["drift_um"] * 1e-6, np.radians(params["turn_deg"])
    keyframes = []
    for time_s, share in ((0.0, -0.5), (0.25, -0.28), (0.5, 0.0), (0.75, 0.22), (1.0, 0.5)):
        shift = [way * share * float(np.cos(azimuth)), way * share * float(np.sin(azimuth)), 0.0]
        keyframes.append({"time_s": time_s, "translate_m": shift})
    return {name: {"keyframes": keyframes} for name in MOVED}


def _placed(name: str, body: Body, params: dict[str, Any], bsdf: Any) -> mi.Mesh:
    tilt = turning([np.cos(params["seed"]), np.sin(params["seed"]), 0.0], params["tilt_deg"])
    turn = tilt @ turning([0, 0, 1], params["turn_deg"])
    return mesh(name, placed(body, [0, 0, 1e-3 * params["height_um"]], turn=turn), bsdf, smooth=False)


def _moulding(random: np.random.Generator) -> np.ndarray:
    """The flat pack from above: black epoxy, coarse in the grain, marked by a laser, a dimple at lead 1."""
    axis = (np.arange(620) + 0.5) / 620 * 2 * BODY_MM - BODY_MM
    shape = axis.size, axis.size
    grey = 0.045 * (1 + 0.25 * noise(shape, (280, 280), random) + 0.15 * cloudy(shape, 12, 3, random))
    lot = f"{random.integers(2600, 2699)} A{random.integers(10, 99)}"
    pieces = lines("SC416-7", 0.52, (0.1, 0.45)) + lines(lot, 0.42, (0.1, -0.45))
    grey += drawn(axis, axis, pieces, 0.085) * (0.17 - grey)
    dimple = np.hypot(axis[None, :] + 1.45, axis[:, None] - 1.45)
    grey *= np.where(np.abs(dimple - 0.2) < 0.02, 2.2, 1.0)
    return grey[::-1].astype(np.float32)


def _values(layout: Layout) -> Body:
    """Plates a hair over the resistors' tops, each with its own part of one picture."""
    chosen = [chip for chip in layout.chips if chip.resistor]
    plates = []
    for k, chip in enumerate(chosen):
        length, wide, high = chip.size
        x, y = 0.24 * length, 0.32 * wide
        z = high + 0.016
        flat = grid([[(-x, -y, z), (x, -y, z)], [(-x, y, z), (x, y, z)]])
        flat = flat._replace(uv=np.column_stack([flat.uv[:, 0], (k + flat.uv[:, 1]) / len(chosen)]))
        plates.append(placed(flat, [*chip.at, 0.0], turn=turning([0, 0, 1], 0.0 if chip.level else 90.0)))
    return joined(plates)


def _value_picture(layout: Layout) -> np.ndarray:
    """The values of all resistors, one over the other, the first at the bottom; white on black glass."""
    chosen = [chip for chip in layout.chips if chip.resistor]
    x, y = (np.arange(96) + 0.5) / 24 - 2.0, (np.arange(64) + 0.5) / 24 - 64 / 48
    words = [drawn(x, y, lines(components.marks(chip), 1.25, (0.0, 0.0)), 0.26) for chip in chosen]
    return (0.035 + 0.55 * np.concatenate(words))[::-1]


def _disc(at: tuple[float, float, float], radius: float, radiance: float) -> dict[str, Any]:
    """A lamp that faces the board."""
    pose = mi.ScalarTransform4f().look_at(origin=list(at), target=[0, 0, 0], up=[0, 1, 0.1])
    return {
        "type": "disk",
        "to_world": pose.scale(radius),
        "bsdf": {"type": "diffuse", "reflectance": 0.0},
        "emitter": {"type": "area", "radiance": radiance},
    }


def _side(azimuth_deg: float) -> tuple[float, float, float]:
    azimuth = np.radians(azimuth_deg)
    return float(SIDE_MM[0] * np.cos(azimuth)), float(SIDE_MM[0] * np.sin(azimuth)), SIDE_MM[1]


def _ring() -> dict[str, Any]:
    """Six lamps round the objective, out of its view."""
    angle = np.arange(6) * np.pi / 3
    places = RING_RADIUS_MM * np.column_stack([np.cos(angle), np.sin(angle)])
    return {
        f"ring_{k}": _disc((float(x), float(y), RING_MM), RING_LAMP_MM, RING_RADIANCE)
        for k, (x, y) in enumerate(places)
    }
