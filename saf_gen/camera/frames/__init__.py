"""Frame cameras: sensors, and the numbers that they read out of light that falls on them during an exposure."""

from saf_gen.camera.frames.camera import FrameCamera
from saf_gen.camera.frames.sensor import FrameSensor, frame_sensor_names, get_frame_sensor

__all__ = ["FrameCamera", "FrameSensor", "frame_sensor_names", "get_frame_sensor"]
