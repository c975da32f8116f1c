"""The spike camera: sensors, the charge they collect from light, and the spikes they fire."""

from saf_gen.camera.encoder import Encoder, charge_knot_weights, encode
from saf_gen.camera.exposure import camera_exposure_scale, charge_stack, photoelectrons_per_irradiance
from saf_gen.camera.fixed_pattern import draw_fixed_pattern
from saf_gen.camera.noise_table import LANES
from saf_gen.camera.sensor import Sensor, get_sensor, sensor_from_text, sensor_names

__all__ = [
    "LANES",
    "Encoder",
    "Sensor",
    "camera_exposure_scale",
    "charge_knot_weights",
    "charge_stack",
    "draw_fixed_pattern",
    "encode",
    "get_sensor",
    "photoelectrons_per_irradiance",
    "sensor_from_text",
    "sensor_names",
]
