"""The camera of the closed loop, which runs while a method moves its lens.

Every readout is encoded with the light, the scene and the lens position of that moment, and the charge of every pixel
carries over from readout to readout. Time passes when a method scores a window, waits, or lets the lens settle. Frames
that have passed never change. The camera delivers whole bytes, so time advances by at least 8 readouts at once.
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

PACKET_FRAMES = 8
"""Number of readouts that the camera delivers at once."""
REST_CHECK_FRAMES = 5 * PACKET_FRAMES
"""Number of readouts between two checks of whether the lens has come to rest."""
REST_TOLERANCE = 1e-3
"""Distance, as a fraction of the travel, within which a lens counts as at rest."""


class RunningCamera:
    """A running camera with all members that the evaluator needs; see :class:`saf_gen.parts.View`.

    A method accesses it through a :class:`saf_gen.benchmark.view.restricted_view.RestrictedView`, which hides the
    members for the evaluator: ``path``, ``commanded_positions``, ``commanded_trajectory``, ``stack_error``, ``scorer``,
    ``settle`` and ``run_until``.

    Parameters
    ----------
    captured : CapturedFrames
        Store for the captured frames.
    measure : callable
        Scores the counts of a window.
    actuator : Actuator
        Motor that moves the lens.
    start : float
        Initial lens position, as a fraction of the travel, 0...1.
    seed : int
        Seed of the noise of the lens.
    budget : int
        Number of frames that may pass, at most those of the capture; rounded down to whole packets.
    readout_hz : float
        Frames per second.
    """

    def __init__(
        self,
        captured: CapturedFrames,
        measure: Callable[..., float],
        *,
        actuator: Actuator,
        start: float,
        seed: int,
        budget: int,
        readout_hz: float,
    ) -> None:
        self._captured, self.scorer = captured, MeteredScorer(measure)
        self.frames, self.readout_hz = budget // PACKET_FRAMES * PACKET_FRAMES, readout_hz
        self.lag_s, self._actuator = actuator.lag_s, actuator
        self._lens = ActuatedLens(actuator, start=start, readout_hz=readout_hz, seed=seed)
        self.now = 0
        """Number of frames that have passed."""
        self.path = np.full(self.frames, start, np.float64)
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
        return self.scorer.score(self.run_until(first, stop), first=first, stop=stop, measure=measure)

    def counts(self, first: int, stop: int) -> np.ndarray:
        """Return the counts of frames ``first <= t < stop``, after running the camera: uint32 (h, w), read-only.

        Raises BadInput if the window is empty, and BudgetSpentError if it ends after the budget.
        """
        return self.scorer.look(self.run_until(first, stop), first=first, stop=stop)

    def run_until(self, first: int, stop: int) -> CapturedFrames:
        """Let the camera run until a window has passed, and return the captured frames.

        Raises BadInput if the window is empty, BudgetSpentError if it ends after the budget, and the error of the focal
        stacks if they cannot be read.
        """
        if stop > self.frames:
            raise BudgetSpentError(f"frame {stop} of a budget of {self.frames}")
        window = validate_window(first, stop, total=self.frames)
        self.wait(max(0, window.stop - self.now))
        try:
            self._captured.encode_until(-(-window.stop // PACKET_FRAMES) * PACKET_FRAMES, self.path)
        except Exception as error:  # kept because a third-party search may catch it
            self.stack_error = error
            raise
        return self._captured

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
            self.wait(REST_CHECK_FRAMES)

    def wait(self, frames: int) -> None:
        """Let at least this many frames pass; if fewer are left, run to the end and raise BudgetSpentError."""
        stop = self.now + math.ceil(frames / PACKET_FRAMES) * PACKET_FRAMES
        sweeping = self.commanded_trajectory is not None
        step = PACKET_FRAMES if sweeping else max(stop - self.now, PACKET_FRAMES)
        for first in range(self.now, min(stop, self.frames), step):
            if self.commanded_trajectory is not None:
                self.move(self.commanded_trajectory(first))
            last = min(first + step, self.frames)
            self.path[first:last] = self._lens.run(last - first)
            self._sensed[first:last] = self._lens.read_sensor(first, last)
            self.now = last
        if stop > self.frames:
            raise BudgetSpentError(f"frame {stop} of a budget of {self.frames}")
