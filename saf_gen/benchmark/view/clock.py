"""How time passes in a running camera of each kind."""

import math
from dataclasses import dataclass

from saf_gen.errors import BadInput
from saf_gen.stack.capture import Capture

PACKET_FRAMES = 8
"""Number of readouts that a camera of bits delivers at once."""
LENS_HZ = 20_000.0
"""Steps per second in which the lens is followed, at least: as often as a spike camera reads out."""


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


def clock_of(capture: Capture) -> Clock:
    """Return how time passes for the camera of a capture.

    A camera of frames delivers frame by frame, each with the lens where it is amid the exposure. Raises BadInput if a
    row of it is still exposed when the next frame begins.
    """
    sensor = capture.sensor
    if capture.camera.form != "frames":
        return Clock(sensor.readout_hz)
    readouts = sensor.readouts((capture.frames + 1) / sensor.readout_hz)
    rows_s, hz = readouts.rows_s, readouts.hz
    if (ends_s := float(rows_s[-1]) + readouts.open_s) > (1 + 1e-9) / hz:
        raise BadInput(
            f"the last row of {sensor.name} is exposed until {ends_s * 1e3:.4g} ms after a frame begins",
            allowed=f"{1e3 / hz:.4g} ms, the time of a frame, in the closed loop",
            hint="choose a shorter exposure, or use --track recorded",
        )
    steps = math.ceil(LENS_HZ / hz)
    return Clock(hz, packet=1, steps=steps, moment=min(int(readouts.middle_s * hz * steps), steps - 1))
