"""The frames at which the lens passes a position, from its positions at the readouts."""

import numpy as np


def find_focus_crossings(focus_position: np.ndarray, at_position: float) -> np.ndarray:
    """Return the frames at which the lens is at ``at_position``: float64, rising; empty where it never is.

    ``focus_position`` (T,) is the lens at the middle of each readout, fraction of the travel. The lens is
    taken to move in straight lines between readouts, and for half a readout at both ends of the recording:
    frames run from -0.5 to T - 0.5. Where the lens rests exactly there, every readout of its rest is listed.
    """
    position = np.asarray(focus_position, dtype=np.float64)
    if position.size < 2:
        return np.flatnonzero(position == at_position).astype(np.float64)
    frame = np.concatenate(([-0.5], np.arange(position.size), [position.size - 0.5]))
    first, last = position[0] + (position[0] - position[1]) / 2, position[-1] + np.diff(position[-2:])[0] / 2
    off = np.concatenate(([first], position, [last])) - at_position
    there = off == 0
    there[0] &= not there[1]  # the lens is at rest, and the readout itself is listed
    there[-1] &= not there[-2]
    i = np.flatnonzero(np.sign(off[:-1]) * np.sign(off[1:]) < 0)
    crossed = frame[i] + (frame[i + 1] - frame[i]) * off[i] / (off[i] - off[i + 1])
    return np.sort(np.concatenate((frame[there], crossed)))
