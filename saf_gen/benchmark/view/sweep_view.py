"""A sweep of the lens of a running camera, as a view for searches that estimate on recordings."""

import math

import numpy as np

from saf_gen.benchmark.view.running_camera import PACKET_FRAMES, RunningCamera
from saf_gen.core.region import validate_window
from saf_gen.errors import BadInput


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
        packet_end = PACKET_FRAMES - self._offset  # a command holds for a packet, and is the position at its end
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
