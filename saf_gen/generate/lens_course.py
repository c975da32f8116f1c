"""The course of the lens of a recording: where it is told to be, and where its actuator puts it."""

from typing import TYPE_CHECKING

import numpy as np

from saf_gen.optics.actuators.actuated_lens import follow_commands
from saf_gen.plugins.motions import POSITION_GRID, lens_positions

if TYPE_CHECKING:
    from saf_gen.generate.resolve import PlannedSequence


def lens_course(sequence: "PlannedSequence", frames: int, *, readout_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Return where the lens of a sequence is in the middle of each readout, and its log.

    Without an actuator, both are the lens motion. With one, the motion is what the actuator is told, the position is
    what comes of it, and the log is what its position sensor reads: the lens or the motor, as its card says.

    Parameters
    ----------
    sequence : PlannedSequence
        The sequence.
    frames : int
        Number of readouts.
    readout_hz : float
        Readouts per second.

    Returns
    -------
    position, log : ndarray of float64, shape (frames,)
        Fractions of the travel, which float32 holds exactly; 0 to 1, but noise may put the log a little outside.

    Raises
    ------
    BadInput
        If the motion does not fit the recording, or leaves the travel.
    """
    told = lens_positions(sequence.motion, frames, readout_hz=readout_hz)
    if sequence.actuator is None:
        return told, told
    did, read = follow_commands(sequence.actuator, told, readout_hz=readout_hz, seed=sequence.actuator_seed)
    return np.round(did / POSITION_GRID) * POSITION_GRID, np.round(read / POSITION_GRID) * POSITION_GRID
