"""A camera that is running while a method moves its lens: the closed loop.

Every readout is encoded with the lens where its actuator has it then, with the light and the scene of that
moment, and the state of every pixel goes on from readout to readout. Time passes when a method looks, waits,
or lets the lens settle; nothing that was seen can be seen again otherwise. The camera hands over whole bytes:
time goes by 8 readouts at least.
"""

import math
from collections.abc import Callable

import numpy as np

from saf_gen.benchmark.view.captured_frames import CapturedFrames
from saf_gen.benchmark.view.metered_scorer import MeteredScorer
from saf_gen.benchmark.view.restricted_view import BudgetSpentError
from saf_gen.core.region import validate_window
from saf_gen.errors import BadInput
from saf_gen.optics.actuators import ActuatedLens, Actuator

__all__ = ["PACKET_FRAMES", "REST_CHECK_FRAMES", "REST_TOLERANCE", "BudgetSpentError", "RunningCamera"]

PACKET_FRAMES = 8  # readouts
REST_CHECK_FRAMES = 5 * PACKET_FRAMES  # readouts from one look at whether the lens rests to the next
REST_TOLERANCE = 1e-3  # of the travel: what is left of a lens's motion where nothing finer is asked for


class RunningCamera:
    """A running camera, in the hands of the referee: see saf_gen.parts.View.

    A method holds it by a :class:`saf_gen.benchmark.view.restricted_view.Handle`, without what is the
    referee's: ``path``,
    ``commanded_positions``, ``commanded_trajectory``, ``stack_error``, ``settle`` and ``run_until``.

    Parameters
    ----------
    film : what the camera has seen, nothing yet.
    actuator, start, seed : what moves the lens, where it stands (0...1), the name of its noise.
    measure : scores the counts of a window.
    budget : frames that may pass, at most those of the take.
    readout_hz : frames a second.

    ``scorer`` is the method's, as on a recording.
    """

    def __init__(
        self,
        film: CapturedFrames,
        measure: Callable[..., float],
        actuator: Actuator,
        *,
        start: float,
        seed: int,
        budget: int,
        readout_hz: float,
    ) -> None:
        self._film, self.scorer = film, MeteredScorer(measure)
        self.frames, self.readout_hz = budget // PACKET_FRAMES * PACKET_FRAMES, readout_hz
        self.lag_s, self._actuator = actuator.lag_s, actuator
        self._lens = ActuatedLens(actuator, start=start, readout_hz=readout_hz, seed=seed)
        self._now = 0
        self.path = np.full(self.frames, start, np.float64)
        """(frames,) where the lens truly was, up to ``now``. For the referee, not for methods."""
        self._sensed = np.full(self.frames, start, np.float64)
        self.commanded_positions = [start]
        """The places that the lens was sent to, in turn, from where it stood."""
        self.commanded_trajectory: Callable[[int], float] | None = None
        """Where the lens is sent at each frame while it sweeps; None: it goes where the last command said."""
        self.stack_error: Exception | None = None
        """Why the stacks could not be filmed, which is no fault of a method's; None where they could."""

    @property
    def now(self) -> int:
        """Frames that have passed."""
        return self._now

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        """The score of a window; the camera runs until it is over.

        Raises BadInput for no window and for a score that is no finite number, BudgetSpentError where the
        window ends after the budget.
        """
        self.run_until(first, stop)
        return self.scorer.score(self._film, first, stop, measure)

    @property
    def windows(self) -> int:
        """Scores asked for."""
        return self.scorer.windows

    @property
    def seconds(self) -> float:
        """What the method computed: see :class:`MeteredScorer`."""
        return self.scorer.seconds

    def run_until(self, first: int, stop: int) -> CapturedFrames:
        """Let the camera run until a window is over; gives what it has seen.

        Raises as ``score`` does, and what the stacks raise where they cannot be read.
        """
        if stop > self.frames:
            raise BudgetSpentError(f"frame {stop} of a budget of {self.frames}")
        window = validate_window(first, stop, self.frames)
        self.wait(max(0, window.stop - self._now))
        if self._film.frames < window.stop:
            try:
                self._film.encode_until(self._now, self.path)
            except Exception as error:
                self.stack_error = error  # kept as well: a method might swallow what is no fault of its own
                raise
        return self._film

    def position(self, frame: int) -> float:
        """What the position sensor of the lens read at a frame that has passed, fraction of the travel."""
        if not 0 <= frame < max(self._now, 1):
            raise BadInput(f"frame {frame} has not passed", allowed=f"0 to {max(self._now - 1, 0)}")
        return float(self._sensed[frame])

    def move(self, to: float) -> None:
        """Command the lens to ``to``; it is on its way when time passes. Raises BadInput outside 0...1."""
        if not 0 <= to <= 1:
            raise BadInput(f"the lens was sent to {to:g}", allowed="0 to 1 of the travel")
        self._lens.command(float(to))
        self.commanded_positions.append(float(to))

    def sweep_command_frames(self, sweep: int) -> float:
        """Frames in which the lens is led from end to end, so that it arrives in ``sweep`` frames."""
        return self._actuator.command_sweep_s(sweep / self.readout_hz) * self.readout_hz

    @property
    def sensor_lead_frames(self) -> float:
        """Frames by which the lens, led steadily, trails what the position sensor reads."""
        return self._actuator.sensor_lead_s * self.readout_hz

    def settle(self, within: float = REST_TOLERANCE) -> None:
        """Let time pass until the lens rests, to ``within`` of the travel. Raises as ``wait`` does."""
        while not self._lens.is_settled(within):
            self.wait(REST_CHECK_FRAMES)

    def wait(self, frames: int) -> None:
        """Let at least so many frames pass. Raises BudgetSpentError, at the end, where fewer are left."""
        stop = self._now + math.ceil(frames / PACKET_FRAMES) * PACKET_FRAMES
        step = (
            PACKET_FRAMES if self.commanded_trajectory is not None else max(stop - self._now, PACKET_FRAMES)
        )
        for first in range(self._now, min(stop, self.frames), step):
            if self.commanded_trajectory is not None:
                self.move(self.commanded_trajectory(first))
            last = min(first + step, self.frames)
            self.path[first:last] = self._lens.run(last - first)
            self._sensed[first:last] = self._lens.read_sensor(first, last)
            self._now = last
        if stop > self.frames:
            raise BudgetSpentError(f"frame {stop} of a budget of {self.frames}")
