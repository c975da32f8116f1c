"""Spike cameras: pixels that fire when they have collected enough charge."""

from saf_gen.camera.encoder import Encoder
from saf_gen.camera.sensor import Sensor

__all__ = ["Encoder", "Sensor"]

CAMERA = Encoder
