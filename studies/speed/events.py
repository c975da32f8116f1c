"""Events: seconds per second of the sensor's time, and the algorithm of v2e on the same light in the same run."""

import sys
from collections.abc import Iterator
from math import log, pi

import numpy as np

from saf_gen.camera import LightCourse, get_sensor
from saf_gen.camera.events import EventCamera, EventSensor
from saf_gen.core import seeds
from studies.speed import synthetic
from studies.speed.bench import Figure, Size, main, shape_text, timed

RUNS = 3
FRAMES_HZ = 20_000  # of the pictures that the algorithm of v2e sees
WHITE = 255.0  # of its pictures
LEAST = 20.0  # grey value below which its logarithm is a straight line
CUTOFF_HZ = 300.0  # v2e's usual value


def run(size: Size) -> Iterator[Figure | str]:
    """Yield our time and v2e's for a second of a sweep, and counts and instants of both in a short one."""
    spikes, sensor = get_sensor(size.sensor), get_sensor("davis346", kind="events")
    light = synthetic.sweep_charge(spikes, size.positions[0]) * np.float32(spikes.readout_hz)
    seconds = size.frames / spikes.readout_hz
    _record(sensor, light[:, :2], seconds=1e-3)  # compiles
    times = [timed(_record, sensor, light, seconds=seconds)[1] for _ in range(RUNS)]
    ours = float(np.median(times)) / seconds
    shape = shape_text((spikes.rows, spikes.columns))
    yield Figure(f"davis346, {shape}, a sweep, everything on, median of {RUNS}", ours, "s per second")
    frames = max(size.public_frames, 40)  # so that a short sweep has events
    theirs = timed(_v2e, sensor, light, seconds=seconds, frames=frames)[1] * FRAMES_HZ / frames
    yield Figure(f"the algorithm of v2e, {frames} pictures of it at {FRAMES_HZ:,} Hz", theirs, "s per second")
    yield Figure("times faster than the algorithm of v2e", theirs / ours, "×", 20.0)
    short = frames / FRAMES_HZ
    dense = timed(_record, sensor, light, seconds=short)[1] / short
    yield Figure(f"the same sweep in {1e3 * short:g} ms: times faster", theirs / dense, "×")
    yield from _compare(sensor, light, frames=frames)


def _course(light: np.ndarray, seconds: float) -> LightCourse:
    """Return the course of a sweep through all knots in steady light."""
    return LightCourse.follow(lambda at: at / seconds, [lambda at: at], span_s=(0.0, seconds), knots=light.shape[1])


def _record(sensor: EventSensor, light: np.ndarray, *, seconds: float) -> int:
    camera, course = EventCamera(sensor, light.shape[2:], seed=1), _course(light, seconds)
    count = 0
    for cell in range(0, len(course.seconds) - 1, 400):  # a block in memory at a time, as in a recording
        count += len(camera.record(light, course.block(cell, min(cell + 400, len(course.seconds) - 1))).t)
    return count


def _v2e(
    sensor: EventSensor, light: np.ndarray, *, seconds: float, frames: int, noise: bool = True
) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Return (time, ON events, OFF events) of each pixel for the first pictures of a sweep, by v2e's algorithm.

    Y. Hu, S.-C. Liu and T. Delbruck, v2e, CVPRW 2021, doi:10.1109/CVPRW53098.2021.00144: a logarithm that is straight
    below 20 grey values, a low pass whose update is in proportion to the light, whole thresholds of the difference
    from a stored level as events, leaks and random events at each picture, and a reset. Events of a picture share the
    time between it and the one before it evenly.
    """
    random = seeds.make_generator("bench", "v2e")
    shape, step = light.shape[2:], 1 / FRAMES_HZ
    spread = sensor.threshold_rms * noise
    on, off = (np.maximum(sensor.threshold_on + spread * random.standard_normal(shape), 0.01) for _ in range(2))
    white = float(light.max())
    stored = followed = None
    last = np.full(shape, -np.inf)
    out = []
    for k in range(frames):
        at = k * step
        knot = at / seconds * (light.shape[1] - 1)
        index = min(int(knot), light.shape[1] - 2)
        picture = (light[0, index] + (knot - index) * (light[0, index + 1] - light[0, index])) * (WHITE / white)
        level = np.where(picture <= LEAST, picture * (log(LEAST) / LEAST), np.log(np.maximum(picture, 1e-3)))
        if stored is None or followed is None:
            stored, followed = level.copy(), level.copy()
            continue
        update = np.minimum((picture + 20) / 275 * step * 2 * pi * CUTOFF_HZ, 1.0) if noise else 1.0
        followed = followed + update * (level - followed)
        if noise:
            stored -= step * sensor.leak_hz * on
        change = followed - stored
        rises, falls = np.floor(np.maximum(change, 0) / on), np.floor(np.maximum(-change, 0) / off)
        if noise:
            chance = sensor.shot_hz / 2 * step * (1 - 0.75 * picture / WHITE)
            drawn = random.random(shape)
            rises, falls = rises + (drawn > 1 - chance), falls + (drawn < chance)
            ready = at - last >= sensor.refractory_s
            rises, falls = rises * ready, falls * ready
            last = np.where((rises + falls) > 0, at, last)
        stored = stored + rises * on - falls * off
        out.append((at, rises, falls))
    return out


def _compare(sensor: EventSensor, light: np.ndarray, *, frames: int) -> Iterator[Figure]:
    """Yield counts without imperfections, and how far the instants of v2e's algorithm are from ours."""
    quiet = sensor.with_noise(**dict.fromkeys(vars(sensor.noise), False))
    camera = EventCamera(quiet, light.shape[2:], seed=1)
    ours = camera.record(light, _course(light, frames / FRAMES_HZ))
    theirs = _v2e(quiet, light, seconds=frames / FRAMES_HZ, frames=frames, noise=False)
    counted = sum(int((rises + falls).sum()) for _, rises, falls in theirs)
    yield Figure("events of v2e's algorithm, everything off, relative to ours", counted / max(len(ours.t), 1), "×")
    instants = np.full(light.shape[2:], np.nan)
    for at, rises, falls in reversed(theirs):
        instants[(rises + falls) > 0] = at
    first = np.full(light.shape[2:], np.nan)
    first[ours.y[::-1], ours.x[::-1]] = ours.t[::-1] * 1e-6
    both = np.isfinite(first) & np.isfinite(instants)
    off = np.abs(instants - first)[both]
    what = "first events of pixels: median distance of v2e's instants from the solved ones"
    yield Figure(what, 1e6 * float(np.median(off)), "µs")


if __name__ == "__main__":
    sys.exit(main(run))
