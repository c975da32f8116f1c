"""Recording of events: what a chip reads out of the crossings that its pixels see."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np

from saf_gen.camera.camera import Camera, LensCourse, Light, Span
from saf_gen.camera.course import LightCourse
from saf_gen.camera.events.kernel import EXPONENTIALS, TICK_S, read_out, record_pixels, record_queue
from saf_gen.camera.events.sensor import EventSensor
from saf_gen.camera.sensor_files import get_sensor
from saf_gen.core.cores import usable_cores
from saf_gen.core.seeds import derive_seed, make_generator
from saf_gen.core.signals import validate_signal
from saf_gen.errors import BadInput

BLOCK_CELLS = 400  # a tenth of a second of even light; memory grows with the events of a block
ROOM = 1 << 20  # events that a thread collects before it hands them over


class Events(NamedTuple):
    """Events in the order in which they are read.

    Attributes
    ----------
    t : ndarray of int64, shape (n,)
        Microseconds since the recording began, not falling.
    x, y : ndarray of uint16, shape (n,)
        Column and row.
    p : ndarray of bool, shape (n,)
        True for a rise of the light.
    """

    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray


def encode_events(light: np.ndarray, sensor: EventSensor | str, *, seconds: float, seed: int) -> Events:
    """Return the events that a camera reports for light that changes linearly between knots.

    Parameters
    ----------
    light : ndarray of float32, shape (K, H, W)
        Photo-electrons per second of each pixel, at least 0, at K knots evenly spaced over the recording; a single
        knot is constant light.
    sensor : EventSensor or str
        An event camera or its name. The array has the size of ``light``, not the sensor's size.
    seconds : float
        Length of the recording, seconds.
    seed : int
        Seed of the device and of its noise. The same seed gives the same events on any machine.

    Returns
    -------
    Events
        Times, columns, rows and polarities, in the order in which they are read. Events that still wait for the readout
        at the end are not among them.

    Raises
    ------
    BadInput
        If the sensor is unknown, ``light`` has a wrong shape or dtype or is negative or not finite, or ``seconds`` is
        not above 0.
    """
    light = validate_signal("charge", light)
    sensor = sensor if isinstance(sensor, EventSensor) else get_sensor(sensor, kind="events")
    knots = light.shape[0]
    course = LightCourse.follow(
        lambda at: at / seconds, [lambda at: at], span_s=(0.0, seconds), knots=knots, parts=max(knots - 1, 1)
    )
    return EventCamera(sensor, light.shape[1:], seed=seed).record(light[None], course)


class EventCamera(Camera):
    """An event camera that records course after course and keeps the state of every pixel in between.

    The events depend neither on the division into courses at the edges of cells nor on the number of threads: those
    which wait for the readout at the end of a course are read in a later one.

    Parameters
    ----------
    sensor : EventSensor
        The sensor to simulate.
    shape : tuple of int
        Rows and columns of the simulated array.
    seed : int
        Seed of the noise.
    device_seed : int, optional
        Seed of what differs between pixels; by default ``seed``.
    rows : slice, optional
        Not used: pixels share a readout, so that all rows are recorded.
    threads : int, optional
        Number of threads; by default one per core that this process may use.

    Attributes
    ----------
    bus_full_s : float
        For how many seconds so far an event has waited for the readout, by more than a microsecond.

    Raises
    ------
    BadInput
        If ``shape`` is not two numbers of at least 1.
    """

    sensor_type, form, model, block = EventSensor, "events", 2, 1 << 62

    def __init__(
        self,
        sensor: EventSensor,
        shape: tuple[int, ...],
        *,
        seed: int,
        device_seed: int | None = None,
        rows: slice | None = None,
        threads: int | None = None,
    ) -> None:
        if len(shape) != 2 or min(shape) < 1:
            raise BadInput(f"the array's shape is {tuple(shape)}", allowed="(rows, columns), each at least 1")
        self.sensor, self.shape = sensor, (int(shape[0]), int(shape[1]))
        size = self.shape[0] * self.shape[1]
        self._constants, phase = _draw_device(
            sensor, size, seed=seed if device_seed is None else device_seed, phase_seed=seed
        )
        self._state = np.full((5, size), -1.0)  # no light yet, not in reset
        self._state[1] = phase
        self._state[3] = make_generator("events", seed, "first waits").standard_exponential(size)
        self._draws = np.zeros(size, np.uint64)
        self._key = np.uint64(derive_seed("events", seed, "noise"))
        self._threads = threads or usable_cores()
        self._pause = 1.0 / sensor.readout_events_per_s if sensor.noise.readout else 0.0
        self._bus_free, self.bus_full_s = -np.inf, 0.0
        self._waiting = _Read(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, bool), np.empty(0))

    @classmethod
    def start(
        cls,
        sensor: EventSensor,
        *,
        shape: tuple[int, int],
        seed: int,
        device_seed: int,
        rows: slice | None = None,
        threads: int | None = None,
    ) -> Self:
        """Return the camera of a recording, as :meth:`saf_gen.camera.Camera.start` does.

        Its noise is another for each sensor.
        """
        seed, device_seed = (derive_seed("events", number, sensor.name) for number in (seed, device_seed))
        return cls(sensor, shape, seed=seed, device_seed=device_seed, threads=threads)

    def expose(self, light: Light, span: Span, *, lens: LensCourse) -> Iterator[Events]:
        """Yield the events of a span in parts; memory does not grow with its length."""
        step = span.packet or span.end - span.begin
        seconds = [(n / light.hz, min(n + step, span.end) / light.hz) for n in range(span.begin, span.end, step)]
        course = LightCourse.joined(
            [LightCourse.follow(lens.at, light.lamps, span_s=both, knots=light.knots) for both in seconds]
        )
        first, stop = int(course.index.min()), min(int(course.index.max()) + 2, light.knots)
        stack = light.charge(span, range(first, stop)) * np.float32(light.hz * light.scale)
        course = course.seen_from(first)
        if len(light.slices_s) > 1:
            course = course.mixed(*light.slices_s[span.slice_index : span.slice_index + 2])
        for cell in range(0, len(course.seconds) - 1, BLOCK_CELLS):
            yield self.record(stack, course.block(cell, min(cell + BLOCK_CELLS, len(course.seconds) - 1)))

    def notes(self) -> dict[str, str]:
        """Return for how many seconds the bus was full."""
        return {"bus_full_s": f"{self.bus_full_s:.6f}"}

    def record(self, stack: np.ndarray, course: LightCourse) -> Events:
        """Record the next cells of time and return their events.

        Parameters
        ----------
        stack : ndarray of float32, shape (G, K, H, W)
            Photo-electrons per second of each light group at each knot, at gain 1.
        course : LightCourse
            Light and lens; its first edge is the last one of the course before it.

        Raises
        ------
        BadInput
            If shapes or dtypes do not match, or the light is negative or not finite.
        """
        stack = np.asarray(stack)
        if stack.dtype != np.float32 or stack.ndim != 4 or stack.shape[2:] != self.shape or 0 in stack.shape:
            raise BadInput(
                f"the stack is {stack.dtype} of shape {stack.shape}",
                allowed=f"float32 (light, focus, {self.shape[0]}, {self.shape[1]})",
            )
        if course.gain.shape[2] != stack.shape[0]:
            raise BadInput(f"the course has {course.gain.shape[2]} light groups", allowed=f"{stack.shape[0]}")
        if not (stack.min() >= 0 and stack.max() < np.inf):  # also false for NaN
            raise BadInput("the light is negative or not finite", allowed="electrons per second, at least 0")
        flat = np.ascontiguousarray(stack).reshape(*stack.shape[:2], -1)
        return self._hand_over(self._record_free(flat, course) or self._record_queue(flat, course), course.seconds[-1])

    def _record_free(self, flat: np.ndarray, course: LightCourse) -> "_Read | None":
        """Return the events of all pixels if the bus is never full; else return None and change nothing."""
        if self._bus_free > course.seconds[0] + TICK_S:
            return None
        before = self._state.copy(), self._draws.copy()
        cuts = np.linspace(0, flat.shape[2], 4 * self._threads + 1).astype(int).tolist()
        with ThreadPoolExecutor(self._threads) as pool:  # the kernel releases the interpreter's lock
            jobs = [pool.submit(self._record_pixels, flat, course, first=a, stop=b) for a, b in pairwise(cuts)]
            parts = [part for job in jobs for part in job.result()]
        when, pixel, rises = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        order = np.lexsort((pixel, when))
        when = when[order]
        read, bus_free = read_out(when, self._pause, self._bus_free)
        wait = read - when
        if wait.max(initial=0.0) > TICK_S:
            self._state, self._draws = before
            return None
        self._bus_free = bus_free
        return _Read(_ticks(read), pixel[order], rises[order], wait)

    def _record_queue(self, flat: np.ndarray, course: LightCourse) -> "_Read":
        """Return the events of all pixels, which are made in the order of their instants."""
        when, read, pixel, rises, self._bus_free = record_queue(
            *self._arguments(flat, course), self._pause, self._bus_free
        )
        return _Read(_ticks(read), pixel, rises, read - when)

    def _arguments(self, flat: np.ndarray, course: LightCourse) -> tuple[Any, ...]:
        """Return what both kernels take: the light, the sensor, and the state of the pixels."""
        noise, sensor = self.sensor.noise, self.sensor
        return (
            flat, course.seconds, course.index, course.fraction, course.gain,
            sensor.dark_e_per_s,
            sensor.receptor_e * noise.bandwidth, sensor.receptor_s * noise.bandwidth,
            sensor.refractory_s * noise.refractory,
            sensor.shot_hz * noise.shot, sensor.shot_half_e_per_s,
            self._constants, self._state, self._draws, self._key, exponential_waits(),
        )  # fmt: skip

    def _record_pixels(
        self, flat: np.ndarray, course: LightCourse, *, first: int, stop: int
    ) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Return the instant, pixel and polarity of the events of some pixels, in the order of the pixels."""
        parts, room, done = [], ROOM, first
        while True:
            when, where, rises = np.empty(room), np.empty(room, np.int64), np.empty(room, bool)
            done, written, lacking = record_pixels(
                done, stop, *self._arguments(flat, course), when, where, rises, False
            )
            parts.append((when[:written].copy(), where[:written].copy(), rises[:written].copy()))
            if done == stop:
                return parts
            room = max(ROOM, lacking)

    def _hand_over(self, read: "_Read", end_s: float) -> Events:
        """Return the events that have been read at the end of a course; the others wait for the next one."""
        read = _Read(*(np.concatenate(columns) for columns in zip(self._waiting, read, strict=True)))
        stop = int(np.searchsorted(read.t, round(end_s * 1e6)))
        self._waiting = _Read(*(column[stop:] for column in read))
        t, pixel, rises, wait = (column[:stop] for column in read)
        self.bus_full_s += float(np.minimum(wait, self._pause)[wait > TICK_S].sum())
        y, x = np.divmod(pixel, self.shape[1])
        return Events(t, x.astype(np.uint16), y.astype(np.uint16), rises)


class _Read(NamedTuple):
    """Events in the order in which they are read: microseconds, pixels, rises of the light, and seconds of waiting."""

    t: np.ndarray
    pixel: np.ndarray
    rises: np.ndarray
    wait: np.ndarray


def _ticks(seconds: np.ndarray) -> np.ndarray:
    """Return whole microseconds, rounded down, int64."""
    return np.floor(seconds * 1e6).astype(np.int64)


@cache
def exponential_waits() -> np.ndarray:
    """Return waiting times of mean 1, float64 (EXPONENTIALS,), read-only: the quantiles of the exponential law.

    They are rounded to multiples of 2⁻²⁰, so that they are the same on machines whose logarithms differ in the last
    digit.
    """
    table = -np.log1p(-(np.arange(EXPONENTIALS) + 0.5) / EXPONENTIALS)
    table = np.round(table * 2.0**20) / 2.0**20
    table.flags.writeable = False
    return table


def _draw_device(sensor: EventSensor, size: int, *, seed: int, phase_seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the constants of the kernel, float64 (3, P), and the factor of the stored level at the beginning, (P,).

    Leaks make ON events, and begin at random between two of them.
    """
    random, noise = make_generator("events", seed, "device"), sensor.noise
    spread = sensor.threshold_rms * noise.mismatch
    on = np.maximum(sensor.threshold_on + spread * random.standard_normal(size), 0.01)
    off = np.maximum(sensor.threshold_off + spread * random.standard_normal(size), 0.01)
    sd = sensor.leak_log_sd * noise.mismatch
    rate = sensor.leak_hz * noise.leak * np.exp(sd * random.standard_normal(size) - 0.5 * sd**2)
    hot = random.random(size) < sensor.hot_fraction
    if noise.hot:
        rate = np.where(hot, sensor.hot_hz, rate)
    phase = make_generator("events", phase_seed, "phases").random(size) * (rate > 0)
    grid = 2.0**-40  # so that machines whose exponentials differ in the last digit agree
    constants = np.stack([np.exp(-on), np.exp(off), on * rate])
    return np.round(constants / grid) * grid, np.round(np.exp(on * phase) / grid) * grid
