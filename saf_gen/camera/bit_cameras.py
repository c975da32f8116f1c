"""The kinds of cameras that count light: spike cameras and single-photon arrays, by bits, and frame cameras.

Files of bits have the same layout, and a running camera of bits is called in the same way.
"""

from pathlib import Path

import numpy as np

from saf_gen.camera.encoder import Encoder
from saf_gen.camera.exposure import firing_rate
from saf_gen.camera.frames import FrameSensor
from saf_gen.camera.sensor import Sensor
from saf_gen.camera.sensor_files import sensor_model
from saf_gen.camera.spad import SpadCamera, SpadSensor
from saf_gen.camera.spad.sensor import detection_rate
from saf_gen.core.config.document import validate_document
from saf_gen.core.config.yaml_document import parse_yaml

BitSensor = Sensor | SpadSensor
CountingSensor = BitSensor | FrameSensor


def parse_sensor(text: str, where: str | Path, *, kind: str = "spikes") -> CountingSensor:
    """Return the sensor that a recording describes: the keys of a sensor file without its ``kind``.

    Parameters
    ----------
    text : str
        The YAML text.
    where : str or Path
        Name of the text in error messages.
    kind : str, default 'spikes'
        Kind of the sensor: ``spikes``, ``photons`` or ``frames``.

    Raises
    ------
    BadInput
        If the text does not describe a valid sensor.
    """
    sensor: CountingSensor = validate_document(sensor_model(kind), parse_yaml(text, where))
    return sensor


def mean_rate(charge: np.ndarray, sensor: BitSensor) -> np.ndarray:
    """Return the ones per readout of a pixel at a constant mean charge per readout, which is counted in photons."""
    if isinstance(sensor, SpadSensor):
        return detection_rate(charge * sensor.gate, sensor)
    return firing_rate(charge, sensor)


def start_camera(
    sensor: BitSensor,
    shape: tuple[int, int],
    *,
    seed: int,
    device_seed: int | None = None,
    rows: slice | None = None,
    threads: int | None = None,
) -> Encoder | SpadCamera:
    """Return a camera of this sensor before its first readout; the arguments are those of :class:`Encoder`."""
    if isinstance(sensor, SpadSensor):
        return SpadCamera(sensor, shape, seed=seed, device_seed=device_seed, rows=rows, threads=threads)
    return Encoder(sensor, shape, seed=seed, device_seed=device_seed, rows=rows, threads=threads)
