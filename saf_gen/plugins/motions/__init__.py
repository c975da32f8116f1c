"""Lens motions: the position of the lens at each time of a recording.

Each kind of motion is a file of this folder, or comes from a package with the entry point ``saf_gen.motions``.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from saf_gen.core.config import registry
from saf_gen.errors import BadInput
from saf_gen.parts import Motion

__all__ = ["get_motion", "lens_positions"]

BLOCK_FRAMES = 1 << 19  # positions computed at a time, so that long recordings need little memory
POSITION_GRID = 2.0**-24
"""Positions are rounded to multiples of this step, which float32 holds exactly. A file therefore stores exactly the
positions behind its spikes, and they are the same on machines whose cosines differ in the last digit."""


def get_motion(name: str, /, **options: Any) -> Motion:
    """Return a lens motion by its name.

    Parameters
    ----------
    name : str
        Kind of motion: a file of ``saf_gen/plugins/motions``, a kind that another package offers,
        ``package.module:Class`` or ``file.py:Class``.
    **options
        Fields of the motion's class.

    Returns
    -------
    Motion
        The motion with these options.

    Raises
    ------
    BadInput
        If the name or an option is unknown, or if a value is not allowed.
    """
    motion: Motion = registry.build_plugin("motions", name, **options)
    return motion


def lens_positions(motion: Motion | Mapping[str, Any], frames: int, *, readout_hz: float) -> np.ndarray:
    """Return the position of the lens at the middle of each readout.

    Parameters
    ----------
    motion : Motion or mapping
        The motion, or its mapping in a recipe, ``{kind: ..., ...}``.
    frames : int
        Number of readouts.
    readout_hz : float
        Readouts per second.

    Returns
    -------
    ndarray of float64, shape (frames,)
        Fractions of the travel, 0 to 1, rounded to multiples of 2**-24.

    Raises
    ------
    BadInput
        If the motion does not fit a recording of this length, or if it leaves the travel.
    """
    if isinstance(motion, Mapping):
        motion = get_motion(motion["kind"], **{k: v for k, v in motion.items() if k != "kind"})
    position = np.empty(frames)
    for begin in range(0, frames, BLOCK_FRAMES):
        block = slice(begin, min(begin + BLOCK_FRAMES, frames))
        seconds = (np.arange(block.start, block.stop) + 0.5) / readout_hz
        position[block] = registry.sample_function(
            motion, motion.positions, seconds=seconds, duration_s=frames / readout_hz
        )
    slack = POSITION_GRID / 2
    if not (position.min() >= -slack and position.max() <= 1 + slack):  # also if a position is NaN
        raise BadInput(
            f"{motion!r} moves the lens over {position.min():.4g} to {position.max():.4g}",
            allowed="0 to 1 of the travel",
        )
    return np.clip(np.round(position / POSITION_GRID) * POSITION_GRID, 0.0, 1.0)
