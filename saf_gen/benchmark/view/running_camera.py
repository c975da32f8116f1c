"""The camera of the closed loop, which runs while a method moves its lens.

Every readout is encoded with the light, the scene and the lens position of that moment, and the charge of every pixel
carries over from readout to readout. Time passes when a method scores a window, waits, or lets the lens settle. Frames
that have passed never change. A camera of bits delivers whole bytes, so its time advances by at least 8 readouts at
once; a frame camera delivers frame by frame.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NoReturn, Protocol

import numpy as np

from saf_gen.benchmark.view.restricted_view import BudgetSpentError, MeteredScorer, TimedWindowSource, no_polarities
from saf_gen.camera.frames import FrameSensor
from saf_gen.core import bits
from saf_gen.core.region import Region, region_shape, validate_window
from saf_gen.errors import BadInput
from saf_gen.optics.actuators import ActuatedLens, Actuator
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stream.interval_texture import window_time_texture
from saf_gen.stream.measure_input import Form

PACKET_FRAMES = 8
"""Number of readouts that a camera of bits delivers at once."""
REST_TOLERANCE = 1e-3
"""Distance, as a fraction of the travel, within which a lens counts as at rest."""


@dataclass(frozen=True)
class Clock:
    """How time passes in a running camera.

    Parameters
    ----------
    readout_hz : float
        Readouts, or frames, per second.
    packet : int, default 8
        Number of readouts that the camera delivers at once; a command to the lens holds for as long.
    steps : int, default 1
        Steps in which the lens is followed in a readout.
    moment : int, default 0
        Step, from 0, at which the lens is where a readout is said to have been taken.
    """

    readout_hz: float
    packet: int = PACKET_FRAMES
    steps: int = 1
    moment: int = 0

    @property
    def rest_check(self) -> int:
        """Number of readouts between two checks of whether the lens has come to rest."""
        return 5 * self.packet if self.packet > 1 else 1

    @property
    def lens_hz(self) -> float:
        """Steps of the lens per second."""
        return self.readout_hz * self.steps


class Captured(TimedWindowSource, Protocol):
    """What a running camera has captured so far, in a region of the sensor, whatever the kind of the camera."""

    def encode_until(self, stop: int, position: np.ndarray) -> None:
        """Capture all readouts before ``stop``, a multiple of the clock's packet.

        ``position``, float64, holds where the lens was in each of the clock's steps, as fractions of the travel. What
        an earlier run captured is kept if its lens was at the same positions.
        """
        ...


class SpikePlanes:
    """Spikes in memory, whose windows are counted and turned into interval textures.

    Parameters
    ----------
    planes : ndarray of uint8, shape (bytes, h, w)
        Spikes of each pixel, packed along time (:mod:`saf_gen.core.bits`).

    Attributes
    ----------
    shape : tuple of int
        Rows and columns.
    textures_s : float
        Computing time of all interval textures so far, in seconds.
    """

    def __init__(self, planes: np.ndarray) -> None:
        self._planes, self.textures_s = planes, 0.0
        self.shape = int(planes.shape[1]), int(planes.shape[2])

    def window(self, first: int, stop: int) -> np.ndarray:
        """Return the counts of frames ``first <= t < stop``, which must be there already: uint32 (h, w)."""
        counts = np.zeros(self.shape, np.uint32)
        bits.sum_planes(self._planes, counts, first=first, stop=stop)
        return counts

    def intervals(self, first: int, stop: int) -> np.ndarray:
        """Return the interval texture of a window, float64 (h, w); see window_texture."""

        def read(first_byte: int, stop_byte: int) -> np.ndarray:
            return self._planes[first_byte:stop_byte].transpose(1, 2, 0)

        image, seconds = window_time_texture(read, self.window, first=first, stop=stop)
        self.textures_s += seconds
        return image

    def polarities(self, first: int, stop: int) -> NoReturn:
        """Raise BadInput, because spikes have no polarity."""
        raise no_polarities()


class CapturedFrames(SpikePlanes):
    """The spikes that a running camera has captured so far, in a region of the sensor.

    Only the rows that a region needs are encoded, and only when a method looks at them. Successive runs of one capture
    share the frames as long as their lenses move along the same path, so all methods that are given a sweep see the
    same spikes.

    Parameters
    ----------
    capture : Capture
        The recording that is captured again.
    charge_source : ChargeSource
        Charge of ``rows_in_view(capture, region)``; runs of one capture may share it.
    region : Region
        Region of the sensor; both ends of its slices are numbers.
    threads : int, optional
        Number of threads that encode; by default one per core.

    Attributes
    ----------
    frames : int
        Number of frames that are encoded so far.
    """

    def __init__(
        self, capture: Capture, charge_source: ChargeSource, *, region: Region, threads: int | None = None
    ) -> None:
        rows, columns = region
        self.capture, self._charge_source = capture, charge_source
        encoded = rows_in_view(capture, region)
        self._create_encoder = partial(capture.create_encoder, encoded, threads=threads)
        self._encoder = self._create_encoder()
        self._inside = slice(rows.start - encoded.start, rows.stop - encoded.start), columns
        super().__init__(np.zeros((-(-capture.frames // 8), *region_shape(region)), np.uint8))
        self._position, self.frames = np.zeros(capture.frames), 0

    def encode_until(self, stop: int, position: np.ndarray) -> None:
        """Encode all readouts before ``stop``, a multiple of 8.

        Frames of an earlier run are kept if its lens was at the same positions in all of them. Otherwise encoding
        starts from the beginning, because the charge of a pixel depends on all earlier readouts.

        Parameters
        ----------
        stop : int
            Number of readouts, a multiple of 8.
        position : ndarray of float64
            Lens position at each readout, as fractions of the travel, 0...1.
        """
        known = min(self.frames, stop)
        if not np.array_equal(self._position[:known], position[:known]):
            self._encoder, self.frames = self._create_encoder(), 0
        begin = self.frames
        if stop <= begin:
            return
        self._position[begin:stop] = position[begin:stop]
        for run in self.capture.plane_source.time_stack.split_at_slices(begin, stop):
            inputs = self._charge_source.encoder_inputs(run, position=position, gain=self.capture.gain)
            spikes = self._encoder.encode(**inputs)[self._inside]
            self._planes[run.begin // 8 : -(-run.end // 8)] = spikes.transpose(2, 0, 1)
            self.frames = run.end


def rows_in_view(capture: Capture, region: Region) -> slice:
    """Return the rows that a region needs, beginning at the start of a block of the encoder's noise.

    A frame is exposed as a whole.
    """
    if isinstance(capture.sensor, FrameSensor):
        return slice(0, capture.sensor.rows)
    step = capture.row_alignment
    return slice(region[0].start // step * step, region[0].stop)


class RunningCamera:
    """A running camera with all members that the evaluator needs; see :class:`saf_gen.parts.View`.

    A method accesses it through a :class:`saf_gen.benchmark.view.restricted_view.RestrictedView`, which hides the
    members for the evaluator: ``path``, ``commanded_positions``, ``commanded_trajectory``, ``stack_error``, ``scorer``,
    ``settle`` and ``run_until``.

    Parameters
    ----------
    captured : Captured
        Store for what the camera captures.
    measure : callable, optional
        Scores the counts of a window; None if the method scores them elsewhere.
    actuator : Actuator
        Motor that moves the lens.
    start : float
        Initial lens position, as a fraction of the travel, 0...1.
    seed : int
        Seed of the noise of the lens.
    budget : int
        Number of frames that may pass, at most those of the capture; rounded down to whole packets.
    clock : Clock
        How time passes.
    operations_per_s : float, optional
        Rate at which the operations of the method take time; by default computing takes none.
    """

    def __init__(
        self,
        captured: Captured,
        measure: Callable[..., float] | None,
        *,
        actuator: Actuator,
        start: float,
        seed: int,
        budget: int,
        clock: Clock,
        operations_per_s: float | None = None,
    ) -> None:
        self.clock, self.readout_hz = clock, clock.readout_hz
        self._frames_per_operation = self.readout_hz / operations_per_s if operations_per_s else 0.0
        self._computed = 0  # frames that have passed while the method computed
        self._captured, self.scorer = captured, MeteredScorer(measure)
        self.frames = budget // clock.packet * clock.packet
        self.lag_s, self._actuator = actuator.lag_s, actuator
        self._lens = ActuatedLens(actuator, start=start, readout_hz=clock.lens_hz, seed=seed)
        self.now = 0
        """Number of frames that have passed."""
        self._followed = np.full(self.frames * clock.steps, start, np.float64)
        self.path = self._followed[clock.moment :: clock.steps]
        """True lens positions up to ``now``, as fractions of the travel, shape (frames,)."""
        self._sensed = np.full(self.frames, start, np.float64)
        self.commanded_positions = [start]
        """The start position, followed by every position to which the lens was sent."""
        self.commanded_trajectory: Callable[[int], float] | None = None
        """Function that returns the commanded position at a frame of a sweep; None outside a sweep."""
        self.stack_error: Exception | None = None
        """Error in reading the focal stacks, which is not the method's fault; None if there was no error."""

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        """Return the score of frames ``first <= t < stop``, after running the camera until they have passed.

        Raises BadInput if the window is empty or if the score is not a finite number, and BudgetSpentError if the
        window ends after the budget.
        """
        score = self.scorer.score(self.run_until(first, stop), first=first, stop=stop, measure=measure)
        self._compute()
        return score

    def counts(self, first: int, stop: int) -> np.ndarray:
        """Return the counts of frames ``first <= t < stop``, after running the camera: uint32 (h, w), read-only.

        Raises BadInput if the window is empty, and BudgetSpentError if it ends after the budget.
        """
        counts = self.scorer.look(self.run_until(first, stop), first=first, stop=stop)
        self._compute()
        return counts

    def polarities(self, first: int, stop: int) -> np.ndarray:
        """Return the events of a window, after running the camera: uint32 (2, h, w), falls and then rises, read-only.

        Raises what :meth:`counts` raises, and BadInput if the camera is no event camera.
        """
        events = self.scorer.look_at_polarities(self.run_until(first, stop), first=first, stop=stop)
        self._compute()
        return events

    def image(self, form: Form, *, first: int, stop: int) -> np.ndarray:
        """Return frames ``first <= t < stop`` as a measure is called with them; raises what :meth:`counts` raises."""
        image = self.scorer.image(self.run_until(first, stop), form, first=first, stop=stop)
        self._compute()
        return image

    def positions(self, first: int) -> np.ndarray:
        """Return the readings of the position sensor at all frames from ``first`` that have passed, float64 (n,)."""
        return self._sensed[first : self.now]

    def run_until(self, first: int, stop: int) -> Captured:
        """Let the camera run until a window has passed, and return what it has captured.

        Raises BadInput if the window is empty, BudgetSpentError if it ends after the budget, and the error of the focal
        stacks if they cannot be read.
        """
        if stop > self.frames:
            raise BudgetSpentError(f"frame {stop} of a budget of {self.frames}")
        window = validate_window(first, stop, total=self.frames)
        self.wait(max(0, window.stop - self.now))
        try:
            packet = self.clock.packet
            self._captured.encode_until(-(-window.stop // packet) * packet, self._followed)
        except Exception as error:  # kept because a third-party search may catch it
            self.stack_error = error
            raise
        return self._captured

    def _compute(self) -> None:
        """Let the time pass that the method's operations take, in whole packets; raises what :meth:`wait` raises."""
        due = self.scorer.operations * self._frames_per_operation - self._computed
        packet = self.clock.packet
        packets = int(due / packet + 1e-9)
        if packets > 0:
            self._computed += packets * packet
            self.wait(packets * packet)

    def position(self, frame: int) -> float:
        """Return the reading of the position sensor at a frame that has passed, as a fraction of the travel."""
        if not 0 <= frame < max(self.now, 1):
            raise BadInput(f"frame {frame} has not passed", allowed=f"0 to {max(self.now - 1, 0)}")
        return float(self._sensed[frame])

    def move(self, to: float) -> None:
        """Command the lens to ``to``; it moves while time passes. Raises BadInput if ``to`` is outside 0...1."""
        if not 0 <= to <= 1:
            raise BadInput(f"the lens was sent to {to:g}", allowed="0 to 1 of the travel")
        self._lens.command(float(to))
        self.commanded_positions.append(float(to))

    def sweep_command_frames(self, sweep: int) -> float:
        """Return how many frames commands must take from end to end so that the lens takes ``sweep`` frames."""
        return self._actuator.command_sweep_s(sweep / self.readout_hz) * self.readout_hz

    @property
    def sensor_lead_frames(self) -> float:
        """Number of frames by which a steadily moving lens trails the reading of the position sensor."""
        return self._actuator.sensor_lead_s * self.readout_hz

    def settle(self, within: float = REST_TOLERANCE) -> None:
        """Let time pass until the lens rests to within a fraction ``within`` of the travel.

        Raises BudgetSpentError if the budget ends first.
        """
        while not self._lens.is_settled(within):
            self.wait(self.clock.rest_check)

    def wait(self, frames: int) -> None:
        """Let at least this many frames pass; if fewer are left, run to the end and raise BudgetSpentError."""
        packet, steps = self.clock.packet, self.clock.steps
        stop = self.now + math.ceil(frames / packet) * packet
        sweeping = self.commanded_trajectory is not None
        step = packet if sweeping else max(stop - self.now, packet)
        for first in range(self.now, min(stop, self.frames), step):
            if self.commanded_trajectory is not None:
                self.move(self.commanded_trajectory(first))
            last = min(first + step, self.frames)
            begin, end = first * steps, last * steps
            self._followed[begin:end] = self._lens.run(end - begin)
            self._sensed[first:last] = self._lens.read_sensor(begin, end)[self.clock.moment :: steps]
            self.now = last
        if stop > self.frames:
            raise BudgetSpentError(f"frame {stop} of a budget of {self.frames}")


class SweepView:
    """The view of a lens that goes from one end of its travel to the other; see :class:`saf_gen.parts.View`.

    Frames count from the beginning of the sweep. The sweep ends after the last window that the search asks for, so a
    search that works in order of time can stop it early.

    Parameters
    ----------
    camera : RunningCamera
        The running camera, whose lens is at rest at ``begin``.
    begin, end : float
        First and last lens position, as fractions of the travel.
    frames : int
        Number of readouts in which the lens goes from ``begin`` to ``end``. The lens trails its commands, which
        therefore run a little faster, in ``camera.sweep_command_frames(frames)``.
    """

    def __init__(self, camera: RunningCamera, *, begin: float, end: float, frames: int) -> None:
        self._camera, self._offset = camera, camera.now
        self.frames, self.readout_hz, self.lag_s = frames, camera.readout_hz, camera.lag_s
        command_frames = camera.sweep_command_frames(frames)
        packet_end = camera.clock.packet - self._offset  # a command holds for a packet, and is the position at its end
        camera.commanded_trajectory = lambda frame: (
            begin + (end - begin) * min((frame + packet_end) / command_frames, 1.0)
        )

    @property
    def now(self) -> int:
        """Number of frames of the sweep that have passed."""
        return self._camera.now - self._offset

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        """Return the score of a window of the sweep; the lens moves on until the window is over.

        Raises BadInput if the window is empty, begins before the sweep or ends after it.
        """
        window = validate_window(first, stop, total=self.frames)
        return self._camera.score(self._offset + window.start, self._offset + window.stop, measure)

    def counts(self, first: int, stop: int) -> np.ndarray:
        """Return the counts of a window of the sweep: uint32 (h, w), read-only.

        Raises BadInput if the window is empty, begins before the sweep or ends after it.
        """
        window = validate_window(first, stop, total=self.frames)
        return self._camera.counts(self._offset + window.start, self._offset + window.stop)

    def polarities(self, first: int, stop: int) -> np.ndarray:
        """Return the events of a window of the sweep: uint32 (2, h, w), falls and then rises, read-only.

        Raises what :meth:`counts` raises, and BadInput if the camera is no event camera.
        """
        window = validate_window(first, stop, total=self.frames)
        return self._camera.polarities(self._offset + window.start, self._offset + window.stop)

    def image(self, form: Form, *, first: int, stop: int) -> np.ndarray:
        """Return a window of the sweep as a measure is called with it; raises what :meth:`counts` raises."""
        window = validate_window(first, stop, total=self.frames)
        return self._camera.image(form, first=self._offset + window.start, stop=self._offset + window.stop)

    def positions(self, first: int) -> np.ndarray:
        """Return the readings of the position sensor at all frames of the sweep from ``first`` that have passed."""
        return self._camera.positions(self._offset + first)

    def position(self, frame: int) -> float:
        """Return the reading of the position sensor at a frame of the sweep, as a fraction of the travel.

        Raises BadInput if the frame has not passed.
        """
        if not 0 <= frame < self.now:
            allowed = f"0 to {self.now - 1}" if self.now else "no frame before the first score"
            raise BadInput(f"frame {frame} has not passed", allowed=allowed)
        return self._camera.position(self._offset + frame)

    def position_at(self, frame: float) -> float:
        """Return the lens position at a fractional frame, as a fraction of the travel, from the position sensor.

        The reading is interpolated linearly between frames. A sensor at the motor reads ahead of the lens, which trails
        the motor; this is corrected. If no frame has passed, the last reading before the sweep is returned.
        """
        last = self.now - 1
        frame -= self._camera.sensor_lead_frames
        before = min(max(math.floor(frame), 0), last)
        after = min(before + 1, last)
        weight = min(max(frame - before, 0.0), 1.0)
        read = [self._camera.position(max(self._offset + t, 0)) for t in (before, after)]
        return (1 - weight) * read[0] + weight * read[1]

    def wait(self, frames: int) -> None:
        """Let at least this many frames pass."""
        self._camera.wait(frames)

    def move(self, to: float) -> None:
        """Raise BadInput, because the lens is sweeping."""
        raise BadInput(
            f"the lens cannot be moved to {to:g} while it sweeps",
            allowed="searches with the class attribute commands = True",
        )
