"""A synthetic recording that needs no renderer: a sweep over a texture that comes into focus and goes out of it.

The contrast of the texture follows a bell curve over the travel, roughly like that of a defocused target. The mean rate
is 0.2 spikes per readout, with all noise of the sensor.
"""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from saf_gen.camera import Encoder, Sensor, get_sensor, knot_weights
from saf_gen.core import seeds
from saf_gen.stream.metadata import Metadata
from saf_gen.stream.stream_writer import StreamWriter
from studies.speed.bench import peak_gib

MEAN_RATE = 0.2
BLOCK = 2000  # frames at a time, as in the recorder
LIGHT_KINDS = ("constant", "continuous", "sudden")


def texture(shape: tuple[int, int]) -> np.ndarray:
    """Return a white texture, uniform between 0.5 and 1.5, float32 (row, col)."""
    return 0.5 + seeds.make_generator("bench", "texture").random(shape, dtype=np.float32)


def sweep_charge(sensor: Sensor, positions: int) -> np.ndarray:
    """Return photo-electrons per readout at evenly spaced positions, float32 (1, focus, row, col)."""
    contrast = np.exp(-(np.linspace(-2, 2, positions, dtype=np.float32) ** 2))[:, None, None]
    stack = (texture((sensor.rows, sensor.columns)) - 1) * contrast
    stack += 1
    stack *= np.float32(MEAN_RATE * sensor.threshold_e)
    return stack[None]


def encode_sweep(
    sensor: Sensor, charge: np.ndarray, *, frames: int, light: str = "constant", number: int = 0
) -> Iterator[np.ndarray]:
    """Yield the spikes of a sweep in consecutive blocks, uint8 (row, col, bytes).

    Recordings with different values of ``number`` have independent noise.
    """
    index, fraction = knot_weights(_sweep(frames), charge.shape[1])
    gain = _gain(light, frames)
    encoder = Encoder(sensor, charge.shape[2:], seed=seeds.derive_seed("bench", "encoder", number))
    for begin in range(0, frames, BLOCK):
        block = slice(begin, begin + BLOCK)
        yield encoder.encode(charge, index=index[block], fraction=fraction[block], gain=gain[block])


def record_sweep(
    path: Path, sensor: Sensor, *, charge: np.ndarray, frames: int, light: str = "constant", number: int = 0
) -> str:
    """Encode a sweep into a stream file block by block, as ``saf-gen generate`` does; return its content_sha256."""
    metadata = Metadata(
        focus_position=_sweep(frames).astype(np.float32), gain=_gain(light, frames), light_names=("lamp",)
    )
    shape = (frames, *charge.shape[2:])
    with StreamWriter(path, shape=shape, readout_hz=sensor.readout_hz, metadata=metadata) as writer:
        for block in encode_sweep(sensor, charge, frames=frames, light=light, number=number):
            writer.write(block)
    return writer.content_sha256


def recording_gib(sensor: str, positions: int, *, frames: int) -> float:
    """Record a sequence into a temporary file, and return this process's peak memory (GiB)."""
    camera = get_sensor(sensor)
    with TemporaryDirectory() as folder:
        record_sweep(Path(folder) / "bench.h5", camera, charge=sweep_charge(camera, positions), frames=frames)
    return peak_gib()


def _sweep(frames: int) -> np.ndarray:
    """Return the position of the lens at the middle of each readout, 0 to 1, float64 (frame,)."""
    return (np.arange(frames) + 0.5) / frames


def _gain(light: str, frames: int) -> np.ndarray:
    """Return the gain of a light of Su et al. (CVPR 2024), float32 (frame, 1): constant, fourfold ramp or ten steps."""
    if light == "continuous":
        gain = np.linspace(0.5, 2.0, frames)
    elif light == "sudden":
        gain = np.array([1.0, 0.4, 2.0])[np.arange(frames) * 10 // frames % 3]
    else:
        gain = np.ones(frames)
    return gain[:, None].astype(np.float32)
