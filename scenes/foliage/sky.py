"""Daylight: the sun as a disc of its true angular size, and a blue sky with a few clouds."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np

SUN_ELEVATION_DEG, SUN_RADIUS_DEG, SUN_M = 38.0, 0.2665, 600.0
SUN_IRRADIANCE = 280.0  # W m^-2 of the visible band on a surface that faces it: 70,000 lux at 250 lm/W
ZENITH, HORIZON, CLOUD, GROUND = 7.0, 17.0, 30.0, 6.0  # W m^-2 sr^-1
AIM = (0.0, 2.0, -5.0)  # the middle of the tree


def sun(azimuth_deg: float) -> dict[str, Any]:
    """The sun; azimuth 0 straight behind the camera, positive to the right, beyond 90 in front of it."""
    e, a = np.radians([SUN_ELEVATION_DEG, azimuth_deg])
    towards = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    radius = SUN_M * float(np.tan(np.radians(SUN_RADIUS_DEG)))
    solid_angle = 2 * np.pi * (1 - float(np.cos(np.radians(SUN_RADIUS_DEG))))
    origin = (np.array(AIM) + SUN_M * towards).tolist()
    pose = mi.ScalarTransform4f().look_at(origin=origin, target=list(AIM), up=[0, 0, 1])
    return {
        "type": "disk",
        "to_world": pose @ mi.ScalarTransform4f().scale(radius),
        "bsdf": {"type": "diffuse", "reflectance": 0.0},
        "emitter": {"type": "area", "radiance": SUN_IRRADIANCE / solid_angle},
    }


def dome(seed: int) -> dict[str, Any]:
    """Bright at the horizon, fair-weather clouds, grass below."""
    rows, columns = 256, 512
    random = np.random.default_rng([seed, 1])
    up = np.cos((np.arange(rows) + 0.5) / rows * np.pi)[:, None]
    clear = ZENITH + (HORIZON - ZENITH) * np.exp(-np.maximum(up, 0) / 0.25)
    puffs = _noise((rows, columns), (26, 22), random) + 0.6 * _noise((rows, columns), (70, 60), random)
    puffs[:, -40:] += (puffs[:, :1] - puffs[:, -40:]) * np.linspace(0, 1, 40)  # it closes on itself
    heaven = clear + np.clip(1.6 * (puffs - 0.25), 0, 1) * (CLOUD - clear)
    picture = np.where(up > 0, heaven, GROUND).astype(np.float32)
    return {"type": "envmap", "bitmap": mi.Bitmap(picture[:, :, None].repeat(3, axis=2))}


def _noise(shape: tuple[int, int], cells: tuple[int, int], random: np.random.Generator) -> np.ndarray:
    """Smooth value noise in -1..1 over a lattice of `cells` down and across."""
    field = random.uniform(-1, 1, (cells[0] + 2, cells[1] + 2))
    for axis in (0, 1):
        at = np.arange(shape[axis]) * (cells[axis] / shape[axis])
        first = at.astype(np.int64)
        part = at - first
        part = part * part * (3 - 2 * part)
        part = part[:, None] if axis == 0 else part[None, :]
        low = np.take(field, first, axis=axis)
        field = low + part * (np.take(field, first + 1, axis=axis) - low)
    return field
