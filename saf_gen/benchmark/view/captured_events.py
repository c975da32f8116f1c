"""The events that a running event camera has captured, while a method moves its lens.

Time passes by readouts of the spike camera, by which lens and truth are logged, in packets of 8. Where the lens was
between them is interpolated, as in a recording; but what comes after a packet is not known at its end, so that over the
last half of its last readout the lens moves on as it did before. Cells of time end where packets do. The events are
therefore the same however often a method looks, and those of a recording but for cells of another length.
"""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from typing import NamedTuple, NoReturn

import numpy as np

from saf_gen.benchmark.view.clock import PACKET_FRAMES
from saf_gen.camera import LightCourse
from saf_gen.camera.events import EventSensor
from saf_gen.camera.events.camera import Events
from saf_gen.core.region import Region, region_shape
from saf_gen.errors import BadInput
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.event_capture import EventCapture


class _Held(NamedTuple):
    """Events in the region in the order in which they were read: microseconds, pixels and rises of the light."""

    t: np.ndarray
    pixel: np.ndarray
    p: np.ndarray


class CapturedEvents:
    """Events in a region of the sensor; the whole array is captured, because its pixels share a readout.

    Successive runs of one capture share the events as long as their lenses move along the same path.

    Parameters
    ----------
    capture : Capture
        The recording that is captured again.
    charge_source : ChargeSource
        Charge of all rows; runs of one capture may share it.
    sensor : EventSensor
        The event camera.
    integrals : sequence of callable
        Integral of the gain of each lamp over time, in seconds.
    region : Region
        Region of the sensor; both ends of its slices are numbers.
    threads : int, optional
        Number of threads; by default one per core.

    Attributes
    ----------
    frames : int
        Number of readouts that are captured so far.
    """

    def __init__(
        self,
        capture: Capture,
        charge_source: ChargeSource,
        *,
        sensor: EventSensor,
        integrals: Sequence[Callable[[np.ndarray], np.ndarray]],
        region: Region,
        threads: int | None = None,
    ) -> None:
        self.capture, self.textures_s, self.shape = capture, 0.0, region_shape(region)
        self._region, self._hz = region, capture.sensor.readout_hz
        self._start: Callable[[], EventCapture] = lambda: EventCapture(
            capture, charge_source, sensor=sensor, integrals=integrals, threads=threads
        )
        self._camera = self._start()
        self._parts: list[_Held] = []
        self._position, self.frames = np.zeros(capture.frames), 0

    def encode_until(self, stop: int, position: np.ndarray) -> None:
        """Capture all readouts before ``stop``, a multiple of 8, with the lens at ``position`` in each of them.

        Events of an earlier run are kept if its lens was at the same positions in all of them. Otherwise capturing
        starts from the beginning, because the state of a pixel depends on all earlier readouts.
        """
        known = min(self.frames, stop)
        if not np.array_equal(self._position[:known], position[:known]):
            self._camera, self._parts, self.frames = self._start(), [], 0
        if stop <= self.frames:
            return
        self._position[self.frames : stop] = position[self.frames : stop]
        lens = _interpolated(self._position[:stop], self._hz)
        for run in self.capture.plane_source.time_stack.split_at_slices(self.frames, stop):
            packets = range(run.begin, run.end, PACKET_FRAMES)
            courses = [self._camera.follow(lens, begin=first, end=first + PACKET_FRAMES) for first in packets]
            for events in self._camera.record(run, _joined(courses)):
                self._keep(events)
            self.frames = run.end

    def window(self, first: int, stop: int) -> np.ndarray:
        """Return the events of each pixel in readouts ``first <= t < stop``, captured already: uint32 (h, w)."""
        total: np.ndarray = self.polarities(first, stop).sum(axis=0, dtype=np.uint32)
        return total

    def polarities(self, first: int, stop: int) -> np.ndarray:
        """Return the falls and then the rises of each pixel in a window that is captured: uint32 (2, h, w)."""
        pixels = self.shape[0] * self.shape[1]
        begin_us, end_us = self._microseconds(first), self._microseconds(stop)
        counts = np.zeros(2 * pixels, np.uint32)
        for part in self._parts[bisect_left(self._parts, begin_us, key=lambda part: part.t[-1]) :]:
            if part.t[0] >= end_us:
                break
            seen = slice(*np.searchsorted(part.t, [begin_us, end_us]))
            index = part.pixel[seen] + pixels * part.p[seen]
            counts += np.bincount(index, minlength=2 * pixels).astype(np.uint32)
        return counts.reshape(2, *self.shape)

    def intervals(self, first: int, stop: int) -> NoReturn:
        """Raise BadInput, because an event camera has no intervals between spikes."""
        raise BadInput("an event camera has no intervals between spikes", allowed="counts of events")

    def _microseconds(self, frame: int) -> int:
        """Return the beginning of a readout, rounded down, so that no later packet adds events to a window."""
        return int(frame * 1e6 / self._hz + 1e-6)

    def _keep(self, events: Events) -> None:
        rows, columns = self._region
        x, y = events.x.astype(np.int64), events.y.astype(np.int64)
        inside = (y >= rows.start) & (y < rows.stop) & (x >= columns.start) & (x < columns.stop)
        if inside.any():
            pixel = (y[inside] - rows.start) * self.shape[1] + x[inside] - columns.start
            self._parts.append(_Held(events.t[inside], pixel, events.p[inside]))


def _interpolated(position: np.ndarray, hz: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return the lens position over seconds; ``position`` holds it in the middle of each readout of whole packets."""
    packets = position.reshape(-1, PACKET_FRAMES)
    ends = np.clip(1.5 * packets[:, -1] - 0.5 * packets[:, -2], 0.0, 1.0)
    within = np.append(np.arange(PACKET_FRAMES) + 0.5, PACKET_FRAMES)
    seconds = (np.arange(len(packets))[:, None] * PACKET_FRAMES + within).ravel() / hz
    places = np.concatenate([packets, ends[:, None]], axis=1).ravel()
    return lambda at: np.interp(at, seconds, places)


def _joined(courses: Sequence[LightCourse]) -> LightCourse:
    """Return the course of consecutive courses."""

    def edges(name: str) -> np.ndarray:
        return np.concatenate([*(getattr(course, name)[:-1] for course in courses), getattr(courses[-1], name)[-1:]])

    gain = np.concatenate([course.gain for course in courses])
    return LightCourse(edges("seconds"), edges("index"), edges("fraction"), gain)
