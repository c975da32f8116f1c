"""A slow reference encoder, one pixel and one readout at a time, simple enough to check by reading."""

from collections.abc import Callable

import numpy as np

from saf_gen.camera.encoder_kernel import LANES, NOISE_TABLE_SIZE, make_noise_table
from saf_gen.camera.fixed_pattern import draw_fixed_pattern
from saf_gen.camera.sensor import Sensor
from saf_gen.core.seeds import derive_seed, make_generator

F = np.float32
MASK = 2**64 - 1


def encode_reference(
    stack: np.ndarray,
    index: np.ndarray,
    fraction: np.ndarray,
    gain: np.ndarray,
    *,
    sensor: Sensor,
    seed: int,
    normal: Callable[[], float] | None = None,
) -> np.ndarray:
    """Return spikes, uint8 (T, H, W), 0 or 1. If ``normal`` is given, it draws the noise instead of the table."""
    _, _, height, width = stack.shape
    pattern = draw_fixed_pattern(sensor, (height, width), seed=seed)
    size = height * width
    table = make_noise_table()[:NOISE_TABLE_SIZE]
    first = make_generator("encoder", seed, "first thresholds").integers(0, NOISE_TABLE_SIZE, size)
    phases = make_generator("encoder", seed, "phases").random(size, dtype=np.float32)
    key = derive_seed("encoder", seed, "noise")
    jitter = F(sensor.reset_jitter * sensor.noise.reset_jitter)
    spikes = np.zeros((len(index), height, width), np.uint8)
    for p in range(size):
        row, column = divmod(p, width)
        level = float(pattern.threshold[row, column])
        variance = level * sensor.noise.shot
        variance += (sensor.threshold_noise_rms * level) ** 2 * sensor.noise.threshold_noise
        sd = F(np.sqrt(variance))
        threshold = F(level) + sd * table[first[p]]
        block, lane = divmod(p, LANES)
        block_key = mix_bits(key + block * 0xD1342543DE82EF95)
        held = phases[p] * threshold
        share = F(1)
        lead, before = F(sensor.row_skew * (height - 1 - row) / max(height - 1, 1)), None
        for t in range(len(index)):
            charge = pattern.dark[row, column]
            for g in range(stack.shape[0]):
                near = stack[g, index[t], row, column] * pattern.response[row, column]
                next_knot = min(index[t] + 1, stack.shape[1] - 1)
                far = stack[g, next_knot, row, column] * pattern.response[row, column]
                charge += F(gain[t, g] * (1 - fraction[t])) * near + F(gain[t, g] * fraction[t]) * far
            window = charge if before is None else charge + lead * (before - charge)
            before, charge = charge, window
            held += share * charge
            share = F(1)
            if held >= threshold:
                spikes[t, row, column] = 1
                most = F(level * sensor.max_excess_thresholds) if sensor.reset == "subtract" else F(0)
                held = min(held - threshold, most)
                share = F(1 - (1.0 if sensor.saturation == "dead_readout" else sensor.reset_loss))
                place = mix_bits(block_key + t * 0x9E3779B97F4A7C15) + lane
                noise = table[place % NOISE_TABLE_SIZE] if normal is None else F(normal())
                threshold = F(level) + np.sqrt(sd * sd + (jitter * charge) * (jitter * charge)) * noise
    return spikes


def mix_bits(word: int) -> int:
    """The finaliser of SplitMix64, modulo 2^64."""
    word &= MASK
    word = ((word ^ (word >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    word = ((word ^ (word >> 27)) * 0x94D049BB133111EB) & MASK
    return word ^ (word >> 31)
