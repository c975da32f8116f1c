"""What a running camera has captured, while a method moves its lens."""

from typing import Protocol

import numpy as np

from saf_gen.benchmark.view.clock import clock_of
from saf_gen.benchmark.view.held import HELD, Held
from saf_gen.benchmark.view.restricted_view import TimedWindowSource
from saf_gen.camera.camera import Camera, LensCourse
from saf_gen.core.region import Region, region_shape
from saf_gen.stack.capture import Capture
from saf_gen.stack.light import SceneLight


class Captured(TimedWindowSource, Protocol):
    """What a running camera has captured so far, in a region of the sensor, whatever the kind of the camera.

    Attributes
    ----------
    capture : Capture
        The recording that is captured again.
    """

    capture: Capture

    def encode_until(self, stop: int, position: np.ndarray) -> None:
        """Capture all readouts before ``stop``, a multiple of the clock's packet.

        ``position``, float64, holds where the lens was in each of the clock's steps, as fractions of the travel. What
        an earlier run captured is kept if its lens was at the same positions.
        """
        ...


class CapturedReadouts:
    """What the camera of a recording has captured so far, in a region of the sensor.

    Only the rows that a region needs are exposed, and only when a method looks at them. Successive runs of one capture
    share the readouts as long as their lenses move along the same path, so that all methods that are given a sweep see
    the same ones.

    Parameters
    ----------
    capture : Capture
        The recording that is captured again.
    light : SceneLight
        Light in ``capture.rows_for(region)``; runs of one capture may share it.
    region : Region
        Region of the sensor; both ends of its slices are numbers.
    threads : int, optional
        Number of threads; by default one per core.

    Attributes
    ----------
    capture : Capture
        The recording that is captured again.
    frames : int
        Number of readouts that are captured so far.
    shape : tuple of int
        Rows and columns of the region.
    held : Held
        What was read out so far.
    textures_s : float
        Computing time of all interval textures so far, in seconds.
    """

    def __init__(self, capture: Capture, light: SceneLight, *, region: Region, threads: int | None = None) -> None:
        self.capture, self.shape, self.frames = capture, region_shape(region), 0
        self.textures_s = 0.0
        self._light, self._threads, self._clock = light, threads, clock_of(capture)
        self._rows = capture.rows_for(region)
        above = self._rows.start
        inside = slice(region[0].start - above, region[0].stop - above), region[1]
        self.held: Held = HELD[capture.camera.form](capture, inside)
        self._camera = self._start()
        self._position = np.zeros(capture.frames * self._clock.steps)

    def _start(self) -> Camera:
        return self.capture.start_camera(self._rows, threads=self._threads)

    def encode_until(self, stop: int, position: np.ndarray) -> None:
        """Capture all readouts before ``stop``, a multiple of the clock's packet.

        Readouts of an earlier run are kept if its lens was at the same positions. Otherwise capturing starts from the
        beginning, because the state of a pixel depends on all earlier readouts; where it does not, from the first
        readout that differs.

        Parameters
        ----------
        stop : int
            Number of readouts.
        position : ndarray of float64
            Lens position in each step of the clock, as fractions of the travel, 0...1.
        """
        steps, known = self._clock.steps, min(self.frames, stop)
        moved = np.flatnonzero(self._position[: known * steps] != position[: known * steps])
        begin = self.frames
        if len(moved):
            begin = 0 if self._camera.keeps_state else int(moved[0]) // steps
            self._camera = self._start()
        if len(moved) or not self._camera.keeps_state:  # also what a run that failed left of later frames
            self.held.forget(begin)
            self.frames = begin
        if stop <= begin:
            return
        self._position[begin * steps : stop * steps] = position[begin * steps : stop * steps]
        lens = self._lens(stop * steps)
        for span in self._light.spans(begin, stop, form=self._camera.form):
            for piece in self._camera.expose(self._light, span._replace(packet=self._clock.packet), lens=lens):
                self.held.keep(span, piece)
            self.frames = span.end

    def _lens(self, steps: int) -> LensCourse:
        """Return where the lens was in the first steps of the clock.

        Between readouts it is interpolated, as in a recording; but what comes after a packet is not known at its end,
        so that over the last half of its last readout the lens moves on as it did before.
        """
        position, hz, packet = self._position[:steps], self._clock.lens_hz, self._clock.packet
        if packet == 1:
            return LensCourse(position, hz)
        packets = position.reshape(-1, packet)
        ends = np.clip(1.5 * packets[:, -1] - 0.5 * packets[:, -2], 0.0, 1.0)
        within = np.append(np.arange(packet) + 0.5, packet)
        seconds = (np.arange(len(packets))[:, None] * packet + within).ravel() / hz
        return LensCourse(position, hz, (seconds, np.concatenate([packets, ends[:, None]], axis=1).ravel()))

    def window(self, first: int, stop: int) -> np.ndarray:
        """Return the counts of readouts ``first <= t < stop``, captured already: uint32 (h, w)."""
        return self.held.window(first, stop)

    def intervals(self, first: int, stop: int) -> np.ndarray:
        """Return the interval texture of a window, float64 (h, w); raise BadInput if the camera has no intervals."""
        image = self.held.intervals(first, stop)
        self.textures_s = self.held.textures_s
        return image

    def polarities(self, first: int, stop: int) -> np.ndarray:
        """Return falls and rises of a window, uint32 (2, h, w); raise BadInput if the camera has no polarities."""
        return self.held.polarities(first, stop)
