"""Motions of the lens: where the drive is at each moment of a recording.

Each kind is one file of this folder, or a package's, offered under the entry point ``saf_gen.motions``.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from saf_gen.core.config import registry
from saf_gen.errors import BadInput
from saf_gen.parts import Motion

__all__ = ["get_motion", "motion_positions_at_readouts"]

BLOCK_FRAMES = 1 << 19  # positions worked out at a time, so that long recordings need little memory
POSITION_GRID = 2.0**-24
"""Positions are rounded to it, and float32 holds it exactly: a file has the positions that made its spikes,
and the last digit of one machine's cosine cannot move one."""


def get_motion(name: str, /, **options: Any) -> Motion:
    """Return a motion of the lens.

    Parameters
    ----------
    name : the kind: a file of ``saf_gen/plugins/motions``, a kind that a package offers, ``package.module:Class`` or
        ``file.py:Class``.
    **options : the fields of the kind's class.

    Raises
    ------
    BadInput : for an unknown name or key, and for a value that is not allowed.
    """
    motion: Motion = registry.build_plugin("motions", name, **options)
    return motion


def motion_positions_at_readouts(motion: Motion | Mapping[str, Any], frames: int, *, readout_hz: float) -> np.ndarray:
    """Return the position of the lens at the middle of each readout.

    ``motion`` is a motion, or one as a recipe writes it, ``{kind: ..., ...}``. The result is float64 (frames,), a
    fraction of the travel, 0...1, on a grid of 2**-24. Raises BadInput for a motion that does not fit a recording of
    this length, or that leaves the travel.
    """
    if isinstance(motion, Mapping):
        motion = get_motion(motion["kind"], **{k: v for k, v in motion.items() if k != "kind"})
    position = np.empty(frames)
    for begin in range(0, frames, BLOCK_FRAMES):
        block = slice(begin, min(begin + BLOCK_FRAMES, frames))
        seconds = (np.arange(block.start, block.stop) + 0.5) / readout_hz
        position[block] = registry.sample_registered_function(
            motion, motion.positions, seconds=seconds, duration_s=frames / readout_hz
        )
    slack = POSITION_GRID / 2
    if not (position.min() >= -slack and position.max() <= 1 + slack):  # also false where a NaN is
        raise BadInput(
            f"{motion!r} brings the lens to {position.min():.4g} ... {position.max():.4g}",
            allowed="0 to 1 of the travel",
        )
    return np.clip(np.round(position / POSITION_GRID) * POSITION_GRID, 0.0, 1.0)
