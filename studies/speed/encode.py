"""The encoder: its rate with all noise on, its growth with the length, and public encoders in the same run."""

import sys
from collections.abc import Iterator

import numpy as np

from saf_gen.camera import Sensor, get_sensor
from saf_gen.core import seeds
from studies.speed import public_encoders, synthetic
from studies.speed.bench import Figure, Size, fresh, main, shape_text, timed

RUNS = 3
LONGER = 10
FAST_CAMERA_HZ = 40_000
MAX_GROWTH = 1.1  # largest factor by which the time per frame may grow


def run(size: Size) -> Iterator[Figure | str]:
    """Yield the rates of our encoder and of public encoders, and our time and memory at ten times the length."""
    sensor = get_sensor(size.sensor)
    charge = synthetic.sweep_charge(sensor, size.positions[0])
    _encode(sensor, charge, frames=16)  # compiles
    times = []
    for _ in range(RUNS):
        times.append(timed(_encode, sensor, charge, frames=size.frames)[1])
    usual = float(np.median(times))
    pixels = sensor.rows * sensor.columns
    rate = pixels * size.frames / usual
    shape = shape_text((sensor.rows, sensor.columns))
    what = f"{shape}, {size.frames:,} frames, all noise on, median of {RUNS}"
    yield Figure(what, rate / 1e9, "10⁹ pixel·frames/s", 2.5)
    yield Figure("times as fast as a camera of 40 kHz", rate / pixels / FAST_CAMERA_HZ, "×", 1.0)
    yield from _public(size, sensor, our_rate=rate)
    _, longer = timed(_encode, sensor, charge, frames=LONGER * size.frames)
    what = f"time per frame of {LONGER * size.frames:,} frames, relative to {size.frames:,}"
    yield Figure(what, longer / LONGER / usual, "×", MAX_GROWTH, at_most=True)
    yield from _memory(size)


def _encode(sensor: Sensor, charge: np.ndarray, *, frames: int) -> None:
    for _ in synthetic.encode_sweep(sensor, charge, frames=frames):
        pass  # one block in memory at a time, as in a recording


def _public(size: Size, sensor: Sensor, *, our_rate: float) -> Iterator[Figure | str]:
    """Yield the rates of public encoders on a still picture in memory, with the same mean spike rate as ours."""
    shape = (sensor.rows, sensor.columns)
    grey = np.rint(255 * synthetic.MEAN_RATE * synthetic.texture(shape)).astype(np.uint8)
    random = seeds.make_generator("bench", "public encoders")
    for encoder in public_encoders.ENCODERS:
        frames = max(1, size.public_frames // encoder.slower)
        _, seconds = timed(encoder.run, np.broadcast_to(grey, (frames, *shape)), random)
        rate = frames / seconds
        yield Figure(f"{encoder.name}: {shape_text(shape)}, {frames} frames", rate, "frames/s")
        times_faster = our_rate / (rate * grey.size)
        yield Figure(f"times faster, all noise on, than {encoder.name}", times_faster, "×")


def _memory(size: Size) -> Iterator[Figure]:
    """Yield the peak memory of a recording, and of another that is ten times as long, each in a fresh process."""
    short, long = (
        fresh(synthetic.recording_gib, size.sensor, size.positions[0], frames=frames)
        for frames in (size.frames, LONGER * size.frames)
    )
    yield Figure(f"peak memory, {size.frames:,} frames recorded", short, "GiB", 2.0, at_most=True)
    what = f"peak memory, {LONGER * size.frames:,} frames recorded"
    yield Figure(what, long, "GiB", 2.0, at_most=True)
    yield Figure("difference of the two", 100 * abs(long / short - 1), "%", 10.0, at_most=True)


if __name__ == "__main__":
    sys.exit(main(run))
