"""The event camera: pixels that report when the logarithm of their light has changed by a threshold."""

from saf_gen.camera.events.camera import EventCamera, encode_events
from saf_gen.camera.events.sensor import EventSensor, event_sensor_names, get_event_sensor

__all__ = ["EventCamera", "EventSensor", "encode_events", "event_sensor_names", "get_event_sensor"]
