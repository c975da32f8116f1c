"""Spike counts of a chequered field of known contrast, through the sensor model."""

import numpy as np

from saf_gen import encode, get_measure, get_sensor
from saf_gen.camera import draw_fixed_pattern

SHAPE = (64, 96)
CONTRAST = 0.3
BOARD = np.where(np.add.outer(np.arange(SHAPE[0]) // 4, np.arange(SHAPE[1]) // 4) % 2, 1.0, -1.0)


def halves_of(rate, frames, *, seed=1):
    """Return counts of both halves of a window of a chequered field lit at this mean rate, plus dark spikes."""
    sensor = get_sensor("vidar_400x250")
    charge = (rate * sensor.threshold_e * (1 + CONTRAST * BOARD)).astype(np.float32)
    spikes = np.unpackbits(encode(charge[None], sensor, frames=frames, seed=seed), axis=2, bitorder="little")[
        :, :, :frames
    ]
    middle = frames // 2
    return np.stack([spikes[:, :, :middle].sum(axis=2), spikes[:, :, middle:].sum(axis=2)]).astype(np.uint32)


def dark_of(seed):
    """Return options of a calibrated measure as a dark recording of this device would give them."""
    sensor = get_sensor("vidar_400x250")
    dark = draw_fixed_pattern(sensor, SHAPE, seed=seed).dark.astype(float)
    return {"dark": dark.mean() / sensor.threshold_e, "dark_rms": dark.std() / dark.mean()}


def expected_score(name, rate, *, contrast, seed):
    """Return the score of this device's noise-free counts, in a window so long that counts are large."""
    sensor = get_sensor("vidar_400x250")
    device = draw_fixed_pattern(sensor, SHAPE, seed=seed)
    light = rate * sensor.threshold_e * (1 + contrast * BOARD)
    frames = 10_000_000
    half = (light * device.response + device.dark) / device.threshold * (frames // 2)
    return get_measure(name, **dark_of(seed))(np.stack([np.rint(half).astype(np.int64)] * 2), frames=frames)
