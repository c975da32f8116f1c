"""Name of the sensor that made a recording, with a digest that distinguishes sensors with different numbers."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from functools import lru_cache

from saf_gen.camera import Sensor, get_sensor, sensor_names
from saf_gen.camera.sensor import parse_sensor
from saf_gen.errors import BadInput


def sensor_of(provenance: Mapping[str, str]) -> str | None:
    """Return the name of the sensor that a recording states, or None if it states no readable sensor.

    If the numbers of the sensor differ from those of the registered sensor of that name, because a recipe changed them
    or because a user wrote the sensor file, six digits of their digest follow the name: ``vidar_400x250#1c2d3e``.
    """
    text = provenance.get("sensor")
    return None if text is None else _name(text)


@lru_cache(maxsize=64)
def _name(text: str) -> str | None:
    try:
        sensor = parse_sensor(text, "/provenance/sensor")
    except BadInput:  # the sensor is from another version, or from an untrusted file
        return None
    digest = _digest(sensor)
    if sensor.name in sensor_names() and digest == _digest(get_sensor(sensor.name)):
        return sensor.name
    return f"{sensor.name}#{digest[:6]}"


def _digest(sensor: Sensor) -> str:
    """Return the digest of a sensor's numbers, without its name and sources."""
    numbers = asdict(sensor)
    del numbers["name"], numbers["sources"]
    return hashlib.sha256(json.dumps(numbers, sort_keys=True).encode()).hexdigest()
