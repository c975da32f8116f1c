"""The frames that a running frame camera has captured, while a method moves its lens."""

import math
from collections.abc import Callable, Sequence
from typing import NoReturn

import numpy as np

from saf_gen.benchmark.view.restricted_view import no_polarities
from saf_gen.benchmark.view.running_camera import Clock
from saf_gen.camera.frames import FrameSensor
from saf_gen.core.region import Region, region_shape
from saf_gen.errors import BadInput
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.frame_capture import expose_light, row_starts_s

LENS_HZ = 20_000.0
"""Steps per second in which the lens is followed, at least: as often as a spike camera reads out."""


def clock_of(capture: Capture) -> Clock:
    """Return how time passes for the camera of a capture.

    A frame camera delivers frame by frame, each with the lens where it is amid the exposure. Raises BadInput if a row
    of it is still exposed when the next frame begins.
    """
    sensor = capture.sensor
    if not isinstance(sensor, FrameSensor):
        return Clock(sensor.readout_hz)
    starts_s, hz = row_starts_s(sensor), sensor.readout_hz
    if (ends_s := float(starts_s[-1]) + sensor.exposure_s) > (1 + 1e-9) / hz:
        raise BadInput(
            f"the last row of {sensor.name} is exposed until {ends_s * 1e3:.4g} ms after a frame begins",
            allowed=f"{1e3 / hz:.4g} ms, the time of a frame, in the closed loop",
            hint="choose a shorter exposure, or use --track recorded",
        )
    steps = math.ceil(LENS_HZ / hz)
    middle_s = float(starts_s.mean()) + sensor.exposure_s / 2
    return Clock(hz, packet=1, steps=steps, moment=min(int(middle_s * hz * steps), steps - 1))


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
    """

    def __init__(
        self,
        capture: Capture,
        charge_source: ChargeSource,
        *,
        integrals: Sequence[Callable[[np.ndarray], np.ndarray]],
        region: Region,
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
        """Return the sum of frames ``first <= t < stop``, which must be there already: uint32 (h, w)."""
        total: np.ndarray = self._numbers[first:stop].sum(axis=0, dtype=np.uint32)
        return total

    def intervals(self, first: int, stop: int) -> NoReturn:
        """Raise BadInput, because a frame camera has no intervals between spikes."""
        raise BadInput("a frame camera has no intervals between spikes", allowed="sums of frames")

    def polarities(self, first: int, stop: int) -> NoReturn:
        """Raise BadInput, because frames have no polarity."""
        raise no_polarities()
