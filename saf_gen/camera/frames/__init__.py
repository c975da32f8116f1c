"""Frame cameras: sensors, and the numbers that they read out of light that falls on them during an exposure."""

from saf_gen.camera.frames.camera import FrameCamera
from saf_gen.camera.frames.sensor import FrameSensor

__all__ = ["FrameCamera", "FrameSensor"]

CAMERA = FrameCamera
