"""Daylight: the sun as a disc of its true angular size, and a sky with clouds."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
from surfaces import noise

SUN_ELEVATION_DEG, SUN_RADIUS_DEG, SUN_M = 42.0, 0.2665, 600.0
SUN_IRRADIANCE = 280.0  # W m^-2 of the visible band on a surface that faces it: 70,000 lux at 250 lm/W
ZENITH, HORIZON, CLOUD, GROUND = 9.0, 26.0, 42.0, 11.0  # W m^-2 sr^-1


def sun(azimuth_deg: float) -> dict[str, Any]:
    """The sun behind the camera; azimuth 0 straight behind, positive to the right."""
    e, a = np.radians([SUN_ELEVATION_DEG, azimuth_deg])
    towards = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    aim = np.array([0.0, 0.0, -40.0])
    radius = SUN_M * float(np.tan(np.radians(SUN_RADIUS_DEG)))
    solid_angle = 2 * np.pi * (1 - float(np.cos(np.radians(SUN_RADIUS_DEG))))
    pose = mi.ScalarTransform4f().look_at(origin=(aim + SUN_M * towards).tolist(), target=aim.tolist(), up=[0, 0, 1])
    return {
        "type": "disk",
        "to_world": pose @ mi.ScalarTransform4f().scale(radius),
        "bsdf": {"type": "diffuse", "reflectance": 0.0},
        "emitter": {"type": "area", "radiance": SUN_IRRADIANCE / solid_angle},
    }


def dome(seed: int) -> dict[str, Any]:
    """A fair sky: bright at the horizon, fair-weather clouds, light ground below."""
    rows, columns = 128, 256
    random = np.random.default_rng([seed, 1])
    up = np.cos((np.arange(rows) + 0.5) / rows * np.pi)[:, None]
    clear = ZENITH + (HORIZON - ZENITH) * np.exp(-np.maximum(up, 0) / 0.22)
    puffs = noise((rows, columns), (14, 12), random) + 0.6 * noise((rows, columns), (30, 28), random)
    puffs[:, -24:] += (puffs[:, :1] - puffs[:, -24:]) * np.linspace(0, 1, 24)  # it closes on itself
    cover = np.clip(2.2 * (puffs - 0.15), 0, 1)
    heaven = clear + cover * (CLOUD - clear)
    picture = np.where(up > 0, heaven, GROUND).astype(np.float32)
    return {"type": "envmap", "bitmap": mi.Bitmap(picture[:, :, None].repeat(3, axis=2))}
