"""Spike counts of a chequered field of known contrast, through the sensor model."""

import numpy as np

from saf_gen import encode, get_sensor

SHAPE = (64, 96)
CONTRAST = 0.3
BOARD = np.where(np.add.outer(np.arange(SHAPE[0]) // 4, np.arange(SHAPE[1]) // 4) % 2, 1.0, -1.0)


def halves_of(rate, frames, *, seed=1):
    """Counts of both halves of a window of a chequered field lit at this mean rate, dark spikes on top."""
    sensor = get_sensor("vidar_400x250")
    charge = (rate * sensor.threshold_e * (1 + CONTRAST * BOARD)).astype(np.float32)
    spikes = np.unpackbits(encode(charge[None], sensor, frames=frames, seed=seed), axis=2, bitorder="little")[
        :, :, :frames
    ]
    middle = frames // 2
    return np.stack([spikes[:, :, :middle].sum(axis=2), spikes[:, :, middle:].sum(axis=2)]).astype(np.uint32)
