"""The course of the lens of a recording: where it is told to be, and where its actuator puts it."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from saf_gen.optics.actuators import Actuator
from saf_gen.optics.actuators.actuated_lens import follow_commands
from saf_gen.plugins.motions import POSITION_GRID, lens_positions


def lens_course(
    motion: Mapping[str, Any], frames: int, *, readout_hz: float, actuator: Actuator | None = None, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Return where the lens of a recording is in the middle of each readout, and its log.

    Without an actuator, both are the lens motion. With one, the motion is what the actuator is told, the position is
    what comes of it, and the log is what its position sensor reads: the lens or the motor, as its card says.

    Parameters
    ----------
    motion : mapping
        Lens motion, as in a recipe, ``{kind: ..., ...}``.
    frames : int
        Number of readouts.
    readout_hz : float
        Readouts per second.
    actuator : Actuator, optional
        What is told the motion.
    seed : int, default 0
        Seed of the actuator.

    Returns
    -------
    position, log : ndarray of float64, shape (frames,)
        Fractions of the travel, which float32 holds exactly; 0 to 1, but noise may put the log a little outside.

    Raises
    ------
    BadInput
        If the motion does not fit the recording, or leaves the travel.
    """
    told = lens_positions(motion, frames, readout_hz=readout_hz)
    if actuator is None:
        return told, told
    did, read = follow_commands(actuator, told, readout_hz=readout_hz, seed=seed)
    return np.round(did / POSITION_GRID) * POSITION_GRID, np.round(read / POSITION_GRID) * POSITION_GRID
