"""The spike camera: sensors, the charge they collect from light, and the spikes they fire."""

from saf_gen.camera.encoder import Encoder, encode, knot_weights
from saf_gen.camera.exposure import (
    charge_stack,
    electrons_per_irradiance,
    exposure_scale,
    irradiance_per_radiance,
)
from saf_gen.camera.fixed_pattern import draw_fixed_pattern
from saf_gen.camera.noise_table import LANES
from saf_gen.camera.sensor import Sensor, get_sensor, sensor_from_text, sensor_names

__all__ = [
    "LANES",
    "Encoder",
    "Sensor",
    "charge_stack",
    "draw_fixed_pattern",
    "electrons_per_irradiance",
    "encode",
    "exposure_scale",
    "get_sensor",
    "irradiance_per_radiance",
    "knot_weights",
    "sensor_from_text",
    "sensor_names",
]
