"""The frames that a running frame camera has captured, while a method moves its lens."""

from collections.abc import Callable, Sequence
from typing import NoReturn

import numpy as np

from saf_gen.benchmark.view.clock import clock_of
from saf_gen.benchmark.view.restricted_view import no_polarities
from saf_gen.core.region import Region, region_shape
from saf_gen.errors import BadInput
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.frame_capture import expose_light, row_starts_s
from saf_gen.stream.frame_file import above_black


class CapturedExposures:
    """Frames in a region of the sensor; a frame depends on its own exposure alone, and on nothing before it.

    Successive runs of one capture share the frames whose exposure had the lens at the same positions.

    Parameters
    ----------
    capture : Capture
        The recording of a scene at rest that is captured again.
    charge_source : ChargeSource
        Charge of all rows; runs of one capture may share it.
    integrals : sequence of callable
        Integral of the gain of each lamp over time, in seconds.
    region : Region
        Region of the sensor; both ends of its slices are numbers.
    threads : int, optional
        As of other cameras; frames are exposed one after another.
    """

    def __init__(
        self,
        capture: Capture,
        charge_source: ChargeSource,
        *,
        integrals: Sequence[Callable[[np.ndarray], np.ndarray]],
        region: Region,
        threads: int | None = None,
    ) -> None:
        self.capture, self.textures_s = capture, 0.0
        self._source, self._integrals, self._region = charge_source, integrals, region
        self._camera = capture.create_frame_camera()
        self._sensor = self._camera.sensor
        self._steps = clock_of(capture).steps
        self.shape = region_shape(region)
        self._numbers = np.zeros((capture.frames, *self.shape), np.uint16)
        self._position, self.frames = np.zeros(capture.frames * self._steps), 0

    def encode_until(self, stop: int, position: np.ndarray) -> None:
        """Expose all frames before ``stop``; ``position`` holds where the lens was in each step."""
        steps, known = self._steps, min(self.frames, stop)
        moved = np.flatnonzero(self._position[: known * steps] != position[: known * steps])
        begin = int(moved[0]) // steps if len(moved) else self.frames
        if stop <= begin:
            return
        self._position[begin * steps : stop * steps] = position[begin * steps : stop * steps]
        hz, numbers, starts_s = self._sensor.readout_hz, np.arange(stop * steps), row_starts_s(self._sensor)

        def lens(at_s: np.ndarray) -> np.ndarray:
            return np.interp(at_s * hz * steps - 0.5, numbers, self._position[: stop * steps])

        for frame in range(begin, stop):
            begin_s = frame / hz + starts_s
            light = expose_light(
                self._source, self._integrals, begin_s=begin_s, exposure_s=self._sensor.exposure_s, position=lens
            )
            self._numbers[frame] = self._camera.expose(light * hz, frame=frame)[self._region]
        self.frames = stop

    def window(self, first: int, stop: int) -> np.ndarray:
        """Return the sum of the light of frames ``first <= t < stop``, which must be there already: uint32 (h, w).

        It is that of :meth:`saf_gen.stream.frame_file.FrameFile.counts`, levels above the black level.
        """
        light = above_black(self._numbers[first:stop], self._sensor.black_level_dn)
        total: np.ndarray = light.sum(axis=0, dtype=np.uint32)
        return total

    def intervals(self, first: int, stop: int) -> NoReturn:
        """Raise BadInput, because a frame camera has no intervals between spikes."""
        raise BadInput("a frame camera has no intervals between spikes", allowed="sums of frames")

    def polarities(self, first: int, stop: int) -> NoReturn:
        """Raise BadInput, because frames have no polarity."""
        raise no_polarities()
