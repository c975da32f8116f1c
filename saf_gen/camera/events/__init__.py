"""The event camera: pixels that report when the logarithm of their light has changed by a threshold."""

from saf_gen.camera.events.camera import EventCamera, encode_events
from saf_gen.camera.events.sensor import EventSensor

__all__ = ["EventCamera", "EventSensor", "encode_events"]

CAMERA = EventCamera
