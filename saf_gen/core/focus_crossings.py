"""When the lens passes a at_position: frames, from the positions at the readouts."""

import numpy as np

__all__ = ["find_crossings"]


def find_crossings(focus_position: np.ndarray, at_position: float) -> np.ndarray:
    """The frames at which the lens stands at ``at_position``: float64, rising; none where it never does.

    ``focus_position`` (T,) is the lens at the middle of each readout, fraction of the travel. Between two
    readouts it moves on a straight line, and goes on so for half a readout at both ends of the recording:
    frames run from -0.5 to T - 0.5. A lens that rests exactly there gives every readout of its rest.
    """
    position = np.asarray(focus_position, dtype=np.float64)
    if position.size < 2:
        return np.flatnonzero(position == at_position).astype(np.float64)
    frame = np.concatenate(([-0.5], np.arange(position.size), [position.size - 0.5]))
    first, last = position[0] + (position[0] - position[1]) / 2, position[-1] + np.diff(position[-2:])[0] / 2
    off = np.concatenate(([first], position, [last])) - at_position
    there = off == 0
    there[0] &= not there[1]  # at rest: the readout itself says it
    there[-1] &= not there[-2]
    i = np.flatnonzero(np.sign(off[:-1]) * np.sign(off[1:]) < 0)
    crossed = frame[i] + (frame[i + 1] - frame[i]) * off[i] / (off[i] - off[i + 1])
    return np.sort(np.concatenate((frame[there], crossed)))
