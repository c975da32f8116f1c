"""Motions of the lens: where the drive is at each moment of a recording.

Each is one file of this folder, or a package's, offered under the entry point ``saf_gen.motions``.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from saf_gen.core.config import registry
from saf_gen.errors import BadInput
from saf_gen.parts import Motion

__all__ = ["get_motion", "readout_positions"]

BLOCK_FRAMES = 1 << 19  # at a time: what a motion works with stays small in the longest recording
GRID = 2.0**-24  # float32 holds it exactly: a file tells the very positions that made its spikes


def get_motion(name: str, **options: Any) -> Motion:
    """The motion ``name`` with its options; raises BadInput for an unknown name or key, or a bad value."""
    return registry.build("motions", name, **options)


def readout_positions(motion: Motion | Mapping[str, Any], frames: int, readout_hz: float) -> np.ndarray:
    """Position of the lens at the middle of each readout, float64 (frames,), 0...1 of the travel.

    ``motion`` is a part, or one as a recipe writes it, ``{kind: ..., ...}``. Positions lie on a grid of
    2**-24 of the travel, so that the last digit of one machine's cosine cannot move a spike on another.

    Raises BadInput for a motion that does not fit a recording of this length, or that leaves the travel.
    """
    if isinstance(motion, Mapping):
        motion = get_motion(motion["kind"], **{k: v for k, v in motion.items() if k != "kind"})
    position = np.empty(frames)
    for begin in range(0, frames, BLOCK_FRAMES):
        block = slice(begin, min(begin + BLOCK_FRAMES, frames))
        seconds = (np.arange(block.start, block.stop) + 0.5) / readout_hz
        position[block] = motion.positions(seconds, frames / readout_hz)
    if not (position.min() >= -GRID / 2 and position.max() <= 1 + GRID / 2):  # also false where a NaN is
        raise BadInput(
            f"{motion!r} brings the lens to {position.min():.4g} ... {position.max():.4g}",
            allowed="0 to 1 of the travel",
        )
    return np.clip(np.round(position / GRID) * GRID, 0.0, 1.0)
