"""Charge to spikes: rate with all noise on, growth with the length, and public encoders in the same run."""

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np

import saf_gen
from saf_gen import seeds
from saf_gen.bench import workload
from saf_gen.bench.child import alone, timed
from saf_gen.bench.figure import Figure, Size, array
from saf_gen.camera import Sensor, get_sensor
from saf_gen.cluster import Tell

__all__ = ["measure", "public_encoders"]

RUNS = 3
LONGER = 10
FAST_CAMERA_HZ = 40_000
MOST_GROWTH = 1.1  # of the time a frame: ours, after the design's 10 % for memory


def measure(size: Size, tell: Tell) -> Iterator[Figure | str]:
    """The encoder alone, then against public ones, then its time and memory at ten times the length."""
    sensor = get_sensor(size.sensor)
    charge = workload.charge(sensor, size.positions[0])
    _encode(sensor, charge, 16)  # compiles
    times = []
    for done in range(RUNS):
        tell("all noise on", done / RUNS)
        times.append(timed(_encode, sensor, charge, size.frames)[1])
    tell("all noise on", 1.0)
    usual = float(np.median(times))
    pixels = sensor.rows * sensor.columns
    rate = pixels * size.frames / usual
    what = f"{array((sensor.rows, sensor.columns))}, {size.frames:,} frames, all noise on, median of {RUNS}"
    yield Figure("encode", what, rate / 1e9, "10⁹ pixel·frames/s", 2.5)
    yield Figure("encode", "times as fast as a camera of 40 kHz", rate / pixels / FAST_CAMERA_HZ, "×", 1.0)
    yield from _public(size, sensor, rate, tell)
    tell(f"{LONGER} times the length", 0.0)
    _, longer = timed(_encode, sensor, charge, LONGER * size.frames)
    tell(f"{LONGER} times the length", 1.0)
    what = f"time a frame of {LONGER * size.frames:,} frames over that of {size.frames:,}"
    yield Figure("encode", what, longer / LONGER / usual, "×", MOST_GROWTH, at_most=True)
    yield from _memory(size, tell)


def public_encoders() -> ModuleType | None:
    """``benchmarks/public_encoders.py`` of the checkout; None where the package was installed without it."""
    path = Path(saf_gen.__file__).resolve().parent.parent / "benchmarks" / "public_encoders.py"
    spec = importlib.util.spec_from_file_location("saf_gen_public_encoders", path)
    if not path.is_file() or spec is None or spec.loader is None:
        return None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _encode(sensor: Sensor, charge: np.ndarray, frames: int) -> None:
    for _ in workload.blocks(sensor, charge, frames):
        pass  # a block is let go before the next is made, as in a recording


def _public(size: Size, sensor: Sensor, ours: float, tell: Tell) -> Iterator[Figure | str]:
    """Their rates on a still picture of our mean rate, held in memory: no file is opened or decoded."""
    public = public_encoders()
    if public is None:
        yield "encode: the public encoders are left out: benchmarks/ is not beside the package"
        return
    shape = (sensor.rows, sensor.columns)
    grey = np.rint(255 * workload.RATE * workload.texture(shape)).astype(np.uint8)
    random = seeds.generator("bench", "public encoders")
    for done, encoder in enumerate(public.ENCODERS):
        tell("public encoders", done / len(public.ENCODERS))
        frames = max(1, size.public_frames // encoder.slower)
        video = np.broadcast_to(grey, (frames, *shape))
        _, took = timed(encoder.run, video, random)
        rate = frames / took
        yield Figure("encode", f"{encoder.name}: {array(shape)}, {frames} frames", rate, "frames/s")
        times_faster = ours / (rate * grey.size)
        yield Figure("encode", f"times faster, all noise on, than {encoder.name}", times_faster, "×")
    tell("public encoders", 1.0)


def _memory(size: Size, tell: Tell) -> Iterator[Figure]:
    """Peak memory of one recording into a file, and of one ten times as long, each in a fresh process."""
    short, long = (
        alone(workload.record_once, size.sensor, size.positions[0], frames, tell=tell)
        for frames in (size.frames, LONGER * size.frames)
    )
    yield Figure("encode", f"peak memory, {size.frames:,} frames recorded", short, "GiB", 2.0, at_most=True)
    what = f"peak memory, {LONGER * size.frames:,} frames recorded"
    yield Figure("encode", what, long, "GiB", 2.0, at_most=True)
    yield Figure("encode", "difference of the two", 100 * abs(long / short - 1), "%", 10.0, at_most=True)
