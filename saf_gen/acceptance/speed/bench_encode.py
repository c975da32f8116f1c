"""The encoder: its rate with all noise on, its growth with the length, and public encoders in the same run."""

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np

import saf_gen
from saf_gen.acceptance.speed import synthetic_recording
from saf_gen.acceptance.speed.bench_figure import BenchFigure, BenchSize, format_bench_shape
from saf_gen.acceptance.speed.fresh_process import run_bench_in_fresh_process, time_benched_call
from saf_gen.camera import Sensor, get_sensor
from saf_gen.core import seeds
from saf_gen.core.execution.job import ReportProgress

RUNS = 3
LONGER = 10
FAST_CAMERA_HZ = 40_000
MAX_GROWTH = 1.1  # largest factor by which the time per frame may grow


def run_bench(size: BenchSize, report: ReportProgress) -> Iterator[BenchFigure | str]:
    """Yield the rates of our encoder and of public encoders, and our time and memory at ten times the length."""
    sensor = get_sensor(size.sensor)
    charge = synthetic_recording.make_bench_charge(sensor, size.positions[0])
    _encode(sensor, charge, frames=16)  # compiles
    times = []
    for done in range(RUNS):
        report("all noise on", done / RUNS)
        times.append(time_benched_call(_encode, sensor, charge, frames=size.frames)[1])
    report("all noise on", 1.0)
    usual = float(np.median(times))
    pixels = sensor.rows * sensor.columns
    rate = pixels * size.frames / usual
    shape = format_bench_shape((sensor.rows, sensor.columns))
    what = f"{shape}, {size.frames:,} frames, all noise on, median of {RUNS}"
    yield BenchFigure("encode", what, rate / 1e9, "10⁹ pixel·frames/s", 2.5)
    yield BenchFigure("encode", "times as fast as a camera of 40 kHz", rate / pixels / FAST_CAMERA_HZ, "×", 1.0)
    yield from _bench_public(size, sensor, our_rate=rate, report=report)
    report(f"{LONGER} times the length", 0.0)
    _, longer = time_benched_call(_encode, sensor, charge, frames=LONGER * size.frames)
    report(f"{LONGER} times the length", 1.0)
    what = f"time per frame of {LONGER * size.frames:,} frames, relative to {size.frames:,}"
    yield BenchFigure("encode", what, longer / LONGER / usual, "×", MAX_GROWTH, at_most=True)
    yield from _bench_memory(size, report)


def load_encoders_to_bench() -> ModuleType | None:
    """Return ``benchmarks/public_encoders.py`` of the checkout as a module, or None if there is no checkout."""
    path = Path(saf_gen.__file__).resolve().parent.parent / "benchmarks" / "public_encoders.py"
    spec = importlib.util.spec_from_file_location("saf_gen_public_encoders", path)
    if not path.is_file() or spec is None or spec.loader is None:
        return None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _encode(sensor: Sensor, charge: np.ndarray, *, frames: int) -> None:
    for _ in synthetic_recording.encode_bench_blocks(sensor, charge, frames=frames):
        pass  # one block in memory at a time, as in a recording


def _bench_public(
    size: BenchSize, sensor: Sensor, *, our_rate: float, report: ReportProgress
) -> Iterator[BenchFigure | str]:
    """Yield the rates of public encoders on a still picture in memory, with the same mean spike rate as ours."""
    public = load_encoders_to_bench()
    if public is None:
        yield "encode: the public encoders are left out: benchmarks/ is not next to the package"
        return
    shape = (sensor.rows, sensor.columns)
    grey = np.rint(255 * synthetic_recording.MEAN_RATE * synthetic_recording.make_bench_texture(shape)).astype(np.uint8)
    random = seeds.make_generator("bench", "public encoders")
    for done, encoder in enumerate(public.ENCODERS):
        report("public encoders", done / len(public.ENCODERS))
        frames = max(1, size.public_frames // encoder.slower)
        _, seconds = time_benched_call(encoder.run, np.broadcast_to(grey, (frames, *shape)), random)
        rate = frames / seconds
        yield BenchFigure("encode", f"{encoder.name}: {format_bench_shape(shape)}, {frames} frames", rate, "frames/s")
        times_faster = our_rate / (rate * grey.size)
        yield BenchFigure("encode", f"times faster, all noise on, than {encoder.name}", times_faster, "×")
    report("public encoders", 1.0)


def _bench_memory(size: BenchSize, report: ReportProgress) -> Iterator[BenchFigure]:
    """Yield the peak memory of a recording, and of another that is ten times as long, each in a fresh process."""
    short, long = (
        run_bench_in_fresh_process(
            synthetic_recording.bench_recording_memory, size.sensor, size.positions[0], frames=frames, report=report
        )
        for frames in (size.frames, LONGER * size.frames)
    )
    yield BenchFigure("encode", f"peak memory, {size.frames:,} frames recorded", short, "GiB", 2.0, at_most=True)
    what = f"peak memory, {LONGER * size.frames:,} frames recorded"
    yield BenchFigure("encode", what, long, "GiB", 2.0, at_most=True)
    yield BenchFigure("encode", "difference of the two", 100 * abs(long / short - 1), "%", 10.0, at_most=True)
