"""A sweep of the running lens for a search that estimates on a recording: the recording, while it is made."""

import math

from saf_gen.benchmark.view.running_camera import PACKET_FRAMES, RunningCamera
from saf_gen.core.region import validate_window
from saf_gen.errors import BadInput

__all__ = ["SweepView"]


class SweepView:
    """The handle on a lens that goes from one end of its travel to the other: see saf_gen.parts.View.

    Frames count from the beginning of the sweep. A search that looks only at what has passed stops the sweep
    where it answers; one that asks for the last window first has made all of it.

    Parameters
    ----------
    live : the running camera, the lens at rest at ``begin``.
    begin, end : places, fractions of the travel.
    frames : readouts in which the lens goes from one to the other. It trails where it is led, so it is led
        a little faster, by ``live.sweep_command_frames``.
    """

    def __init__(self, live: RunningCamera, begin: float, end: float, *, frames: int) -> None:
        self._live, self._offset = live, live.now
        self.frames, led = frames, live.sweep_command_frames(frames)
        passed = (
            PACKET_FRAMES - self._offset
        )  # a command stands for a packet, and is the place at the packet's end
        live.commanded_trajectory = lambda frame: begin + (end - begin) * min((frame + passed) / led, 1.0)

    @property
    def now(self) -> int:
        """Frames of the sweep that have passed."""
        return self._live.now - self._offset

    @property
    def readout_hz(self) -> float:
        """Frames a second."""
        return self._live.readout_hz

    @property
    def lag_s(self) -> float:
        """See saf_gen.parts.View."""
        return self._live.lag_s

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        """The score of a window of the sweep; the lens goes on until it is over.

        Raises BadInput for no window, and for one that begins before the sweep or ends after it.
        """
        window = validate_window(first, stop, self.frames)
        return self._live.score(self._offset + window.start, self._offset + window.stop, measure)

    def position(self, frame: int) -> float:
        """What the position sensor read at a frame of the sweep that has passed; BadInput for another."""
        if not 0 <= frame < self.now:
            allowed = f"0 to {self.now - 1}" if self.now else "none before the first look"
            raise BadInput(f"frame {frame} has not passed", allowed=allowed)
        return self._live.position(self._offset + frame)

    def position_at(self, frame: float) -> float:
        """Where the lens was at a fractional frame that has passed, as far as its sensor knows.

        Linear between frames. A sensor at the motor was there before the lens, by as long as that trails.
        Where no frame has passed, where the lens stood before.
        """
        last = self.now - 1
        frame -= self._live.sensor_lead_frames
        before = min(max(math.floor(frame), 0), last)
        after = min(before + 1, last)
        share = min(max(frame - before, 0.0), 1.0)
        read = [self._live.position(max(self._offset + t, 0)) for t in (before, after)]
        return (1 - share) * read[0] + share * read[1]

    def wait(self, frames: int) -> None:
        """Let so many frames pass."""
        self._live.wait(frames)

    def move(self, to: float) -> None:
        """Raises BadInput: the lens is sweeping."""
        raise BadInput(
            f"the lens cannot be moved to {to:g} while it sweeps",
            allowed="searches with the class attribute commands = True",
        )
