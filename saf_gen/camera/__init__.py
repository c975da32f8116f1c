"""The spike camera: sensors, the charge that they collect from light, and the spikes that they fire."""

from saf_gen.camera.encoder import Encoder, encode, encoder_knot_weights
from saf_gen.camera.exposure import camera_exposure_scale, sensor_charge_of_images, sensor_electrons_per_irradiance
from saf_gen.camera.fixed_pattern import draw_sensor_fixed_pattern
from saf_gen.camera.noise_table import LANES
from saf_gen.camera.sensor import Sensor, get_sensor, parse_sensor, sensor_names

__all__ = [
    "LANES",
    "Encoder",
    "Sensor",
    "camera_exposure_scale",
    "draw_sensor_fixed_pattern",
    "encode",
    "encoder_knot_weights",
    "get_sensor",
    "parse_sensor",
    "sensor_charge_of_images",
    "sensor_electrons_per_irradiance",
    "sensor_names",
]
