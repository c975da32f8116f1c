"""Spikes, photons and frames of the same sweep: processor seconds on one core per second of the sensor's time."""

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import log
from time import process_time
from types import SimpleNamespace
from typing import Any

import numpy as np

from saf_gen.camera import Encoder, get_sensor, knot_weights
from saf_gen.camera.camera import LensCourse, Span
from saf_gen.camera.frames import FrameCamera
from saf_gen.camera.photons import SpadCamera
from studies.speed import synthetic
from studies.speed.bench import Figure, Size, main, shape_text

RUNS = 3
SMALL_SHAPE = (128, 128)
AT_MOST = 1.0  # times the time of spikes
WELL = 0.5  # of a frame camera, which the mean of the sweep fills in an exposure


def run(size: Size) -> Iterator[Figure | str]:
    """Yield the time of each camera on two arrays, and its ratio to the time of spikes in the same run."""
    sensor = get_sensor(size.sensor)
    shapes = [(sensor.rows, sensor.columns), SMALL_SHAPE]
    for rows, columns in dict.fromkeys(shapes):
        yield from _compare(size, (rows, columns))


def _compare(size: Size, shape: tuple[int, int]) -> Iterator[Figure]:
    """Yield the figures of one array."""
    spikes = replace(get_sensor(size.sensor), rows=shape[0], columns=shape[1])
    charge = synthetic.sweep_charge(spikes, size.positions[0])
    seconds, text = size.frames / spikes.readout_hz, shape_text(shape)
    works = {spikes.name: (spikes.readout_hz, lambda s: _bits(Encoder(spikes, shape, seed=1, threads=1), charge, s))}
    for name in ("qvga_spad", "swissspad3"):
        works[name] = _photons(name, charge)
    works["imx273"] = _frames("imx273", charge)
    times: dict[str, list[float]] = {name: [] for name in works}
    for _, work in works.values():
        work(0.01 * seconds)  # compiles
    for _ in range(RUNS):  # in turn, so that a machine that is busy for a while delays all alike
        for name, (_, work) in works.items():
            begin = process_time()
            work(seconds)
            times[name].append((process_time() - begin) / seconds)
    reference = float(np.median(times[spikes.name]))
    for name, (hz, _) in works.items():
        ours = float(np.median(times[name]))
        each = ours / hz / (shape[0] * shape[1])
        yield Figure(f"{name}, {text}, a sweep, one core, median of {RUNS}", ours, "processor s per second")
        yield Figure(f"{name}, {text}: per pixel and readout", 1e9 * each, "ns")
        if name != spikes.name:
            target = AT_MOST if hz <= spikes.readout_hz else None  # five times as many readouts take longer
            what = f"{name}, {text}: a second of it, relative to a second of spikes"
            yield Figure(what, ours / reference, "×", target, at_most=True)
            what = f"{name}, {text}: a readout of a pixel, relative to one of spikes"
            yield Figure(what, each / (reference / spikes.readout_hz / (shape[0] * shape[1])), "×")


def _bits(camera: Encoder | SpadCamera, stack: np.ndarray, seconds: float) -> None:
    """Record a sweep through all knots block by block, as a recording is made."""
    frames = max(round(seconds * camera.sensor.readout_hz), 8)
    index, fraction = knot_weights((np.arange(frames) + 0.5) / frames, stack.shape[1])
    for begin in range(0, frames, synthetic.BLOCK):
        block = slice(begin, begin + synthetic.BLOCK)
        count = len(index[block])
        camera.encode(stack, index=index[block], fraction=fraction[block], gain=np.ones((count, 1)))


def _photons(name: str, charge: np.ndarray) -> tuple[float, Callable[[float], None]]:
    """Return the rate of an array of single photons, and its recording, in which half of the bits are ones."""
    sensor, shape = get_sensor(name, kind="photons"), (charge.shape[2], charge.shape[3])
    light = (charge * (log(2) / sensor.gate / charge.mean())).astype(np.float32)
    return sensor.readout_hz, lambda s: _bits(SpadCamera(sensor, shape, seed=1, threads=1), light, s)


def _frames(name: str, charge: np.ndarray) -> tuple[float, Callable[[float], None]]:
    """Return the rate of a frame camera, and its recording, which follows the lens through each exposure."""
    sensor, shape, positions = get_sensor(name, kind="frames"), (charge.shape[2], charge.shape[3]), charge.shape[1]
    scale = WELL * sensor.full_well_e / sensor.exposure_s / float(charge.mean())
    light: Any = SimpleNamespace(  # as a recording has it, without a folder of stacks
        hz=1.0,
        scale=scale,
        knots=positions,
        slices_s=(0.0,),
        lamps=[lambda at: at],
        charge=lambda span, knots: np.concatenate([charge[:, knots.start : knots.stop]]),
    )

    def record(seconds: float) -> None:
        camera = FrameCamera(sensor, shape, seed=1)
        frames = max(round(seconds * sensor.readout_hz), 1)
        lens = LensCourse(np.array([0.0, 1.0]), 1 / seconds, (np.array([0.0, seconds]), np.array([0.0, 1.0])))
        for _ in camera.expose(light, Span(0, frames), lens=lens):
            pass

    return sensor.readout_hz, record


if __name__ == "__main__":
    sys.exit(main(run))
