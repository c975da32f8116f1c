"""Focus crossings: the frames at which the lens passes a position, from its positions at the readouts."""

import numpy as np


def focus_crossings(focus_position: np.ndarray, at_position: float) -> np.ndarray:
    """Return the frames at which the lens is at a position.

    The position is interpolated linearly between readouts, and extrapolated by half a readout at both ends of the
    recording, so frames run from -0.5 to T - 0.5. If the lens rests exactly at the position, every readout during the
    rest is listed.

    Parameters
    ----------
    focus_position : ndarray, shape (T,)
        Position of the lens in the middle of each readout, as a fraction of the travel.
    at_position : float
        The position to find, as a fraction of the travel.

    Returns
    -------
    ndarray of float64
        Frames in increasing order; empty if the lens is never there.
    """
    position = np.asarray(focus_position, dtype=np.float64)
    if position.size < 2:
        return np.flatnonzero(position == at_position).astype(np.float64)
    frame = np.concatenate(([-0.5], np.arange(position.size), [position.size - 0.5]))
    first, last = position[0] + (position[0] - position[1]) / 2, position[-1] + np.diff(position[-2:])[0] / 2
    off = np.concatenate(([first], position, [last])) - at_position
    is_at = off == 0
    is_at[0] &= not is_at[1]  # the lens is at rest, and the readout itself is listed
    is_at[-1] &= not is_at[-2]
    i = np.flatnonzero(np.sign(off[:-1]) * np.sign(off[1:]) < 0)
    crossed = frame[i] + (frame[i + 1] - frame[i]) * off[i] / (off[i] - off[i + 1])
    return np.sort(np.concatenate((frame[is_at], crossed)))
