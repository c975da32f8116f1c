"""The camera of the closed loop, which runs while a method moves its lens.

Every readout is encoded with the light, the scene and the lens position of that moment, and the charge of every pixel
carries over from readout to readout. Time passes when a method scores a window, waits, or lets the lens settle. Frames
that have passed never change. A camera of bits delivers whole bytes, so its time advances by at least 8 readouts at
once; a frame camera delivers frame by frame.
"""

import math
from collections.abc import Callable

import numpy as np

from saf_gen.benchmark.view.captured import Captured
from saf_gen.benchmark.view.clock import Clock
from saf_gen.benchmark.view.restricted_view import BudgetSpentError, MeteredScorer
from saf_gen.core.region import validate_window
from saf_gen.errors import BadInput
from saf_gen.optics.actuators import ActuatedLens, Actuator
from saf_gen.stream.measure_input import Form

REST_TOLERANCE = 1e-3
"""Distance, as a fraction of the travel, within which a lens counts as at rest."""


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
            hint = "" if self.now else "let time pass first: view.wait(1)"
            raise BadInput(f"frame {frame} has not passed", allowed=f"0 to {max(self.now - 1, 0)}", hint=hint)
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
