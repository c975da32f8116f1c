"""Cameras: sensors, the charge that they collect from light, and what they read out."""

from saf_gen.camera.course import LightCourse
from saf_gen.camera.encoder import Encoder, encode, knot_weights
from saf_gen.camera.encoder_kernel import LANES
from saf_gen.camera.exposure import charge_of_images, electrons_per_irradiance, exposure_scale
from saf_gen.camera.fixed_pattern import draw_fixed_pattern
from saf_gen.camera.kinds import parse_sensor
from saf_gen.camera.sensor import Sensor
from saf_gen.camera.sensor_files import get_sensor, sensor_names

__all__ = [
    "LANES",
    "Encoder",
    "LightCourse",
    "Sensor",
    "charge_of_images",
    "draw_fixed_pattern",
    "electrons_per_irradiance",
    "encode",
    "exposure_scale",
    "get_sensor",
    "knot_weights",
    "parse_sensor",
    "sensor_names",
]
