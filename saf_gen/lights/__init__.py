"""Light schedules: how the gain of a light group moves over a recording."""

from typing import Any

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.lights import _schedule
from saf_gen.parts import Light

__all__ = ["get_light", "readout_gains"]


def get_light(name: str, **options: Any) -> Light:
    """The light schedule ``name`` with its options, those of :mod:`saf_gen.lights._schedule` among them.

    Raises BadInput for an unknown name or key, and for a value that is not allowed.
    """
    return _schedule.build_light(name, **options)


def readout_gains(light: Light, frames: int, readout_hz: float) -> np.ndarray:
    """Mean gain of each readout, float32 (frames,).

    The mean over a readout, not a sample in it: a lamp that flickers at 100 Hz then gives the same sum in
    every window of 200 readouts at 20 kHz, as it does on a sensor that integrates.

    Raises BadInput when the schedule goes below 0: there is no negative light.
    """
    edges = np.arange(frames + 1) / readout_hz
    gains = np.diff(light.integral(edges, frames / readout_hz)) * readout_hz
    if not gains.min() >= -1e-9:
        raise BadInput(f"the gain of {light!r} falls to {gains.min():.3g}", allowed="gains of 0 and more")
    # On a grid of 2**-20, so that the last digit of one machine's cosine cannot move a spike on another.
    return (np.round(np.maximum(gains, 0) * 2**20) / 2**20).astype(np.float32)
