"""A small scene on which methods are tried, and recordings of it, without a renderer or a dataset.

The scene is a flat texture with the spectrum of natural scenes, in front of a sensor with realistic noise. It is
blurred by a Gaussian whose sigma grows with the distance of the lens from the best focus.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from saf_gen.benchmark.conformance._sample_counts import sample_texture
from saf_gen.camera import Sensor, charge_of_images, encode, exposure_scale, get_sensor
from saf_gen.optics import ImageDistanceDrive
from saf_gen.stream.metadata import Metadata, Truth
from saf_gen.stream.stream_writer import StreamWriter

ROWS, COLUMNS, POSITIONS = 32, 48, 33
BLUR = 8.0  # sigma in pixels at a distance of one travel from the best focus
BEST_FOCUS = 0.4
TARGET_RATE = 0.2  # spikes per pixel and readout
OVEREXPOSURE = 50.0  # multiple of that light at which every pixel fires at nearly every readout
DRIVE = ImageDistanceDrive(0.025, 2.0, (0.6, 0.42))


@dataclass(frozen=True, eq=False)
class ConformanceScene:
    """A focal stack with its best focus at a given position, the lens drive and the sensor.

    Attributes
    ----------
    best : float
        Position of best focus, as a fraction of the travel.
    radiance : ndarray of float32, shape (light, focus, row, col)
        Focal stack of each light.
    drive : ImageDistanceDrive
        Drive of the lens.
    sensor : Sensor
        The sensor.
    exposure : float
        Factor that scales the light so that the sensor fires TARGET_RATE spikes per pixel and readout at best focus.
    """

    best: float
    radiance: np.ndarray
    drive: ImageDistanceDrive
    sensor: Sensor
    exposure: float

    def charge(self) -> np.ndarray:
        """Return the charge at the scene's exposure, in electrons per readout, float32 (focus, row, col)."""
        return _charge(self.radiance, self.sensor)[0] * np.float32(self.exposure)


@lru_cache
def make_scene(best: float) -> ConformanceScene:
    """Return the scene with its best focus at the position ``best``, a fraction of the travel."""
    sensor = get_sensor("vidar_400x250", rows=ROWS, columns=COLUMNS)
    sharp = sample_texture(ROWS, COLUMNS)
    distance = np.abs(np.linspace(0, 1, POSITIONS) - best)
    radiance = np.stack([gaussian_filter(sharp, BLUR * d, mode="wrap") for d in distance])[None].astype(np.float32)
    at_best = _charge(radiance, sensor)[0, int(distance.argmin())]
    exposure = exposure_scale(at_best, np.ones((ROWS, COLUMNS), bool), sensor=sensor, mean_rate=TARGET_RATE)
    return ConformanceScene(best, radiance, DRIVE, sensor, exposure)


def write_recordings(folder: Path, frames: int) -> dict[str, Path]:
    """Write recordings of ``frames`` frames and return their paths by name.

    The names are ``empty``, ``full``, ``saturated`` and ``swept``; the first two have no lens positions.
    """
    scene = make_scene(BEST_FOCUS)
    empty = np.zeros((ROWS, COLUMNS, -(-frames // 8)), np.uint8)
    full = np.broadcast_to(np.packbits(np.arange(frames) >= 0, bitorder="little"), empty.shape)
    swept, saturated = (
        encode(scene.charge() * np.float32(gain), scene.sensor, frames=frames, seed=1) for gain in (1, OVEREXPOSURE)
    )
    lens = ((np.arange(frames) + 0.5) / frames).astype(np.float32)
    known = Metadata(focus_position=lens, truth=Truth(position=BEST_FOCUS, frame=BEST_FOCUS * frames - 0.5))
    paths = {}
    for name, spikes in {"empty": empty, "full": full, "saturated": saturated, "swept": swept}.items():
        metadata = Metadata() if name in ("empty", "full") else known
        paths[name] = folder / f"{name}.h5"
        with StreamWriter(paths[name], shape=(frames, ROWS, COLUMNS), metadata=metadata) as writer:
            writer.write(spikes)
    return paths


def _charge(radiance: np.ndarray, sensor: Sensor) -> np.ndarray:
    return charge_of_images(radiance, sensor, lens=DRIVE, position=np.linspace(0, 1, POSITIONS))
