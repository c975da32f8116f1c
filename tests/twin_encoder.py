"""The encoder once more, one pixel and one readout at a time: slow, and plain enough to check by reading."""

from collections.abc import Callable

import numpy as np

from saf_gen.camera.response import fixed_pattern
from saf_gen.camera.sensor import Sensor
from saf_gen.seeds import generator, integer

F = np.float32
MASK = 2**32 - 1


def twin_frames(
    stack: np.ndarray,
    index: np.ndarray,
    fraction: np.ndarray,
    gain: np.ndarray,
    *,
    sensor: Sensor,
    seed: int,
    normal: Callable[[], float] | None = None,
) -> np.ndarray:
    """Spikes uint8 (T, H, W), 0 or 1. ``normal`` draws the noise instead of the sum of four bytes."""
    _, _, height, width = stack.shape
    pattern = fixed_pattern(sensor, (height, width), seed=seed)
    size = height * width
    generators = generator("encoder", seed, "lanes").integers(1, 2**32, size, dtype=np.uint32)
    first = generator("encoder", seed, "first thresholds").integers(0, 256, (4, size)).sum(axis=0)
    phases = generator("encoder", seed, "phases").random(size, dtype=np.float32)
    words = [split_mix(integer("encoder", seed, "words"), t) for t in range(len(index))]
    spikes = np.zeros((len(index), height, width), np.uint8)
    for p in range(size):
        row, column = divmod(p, width)
        level = float(pattern.threshold[row, column])
        variance = level * sensor.noise.shot
        variance += (sensor.threshold_noise_rms * level) ** 2 * sensor.noise.threshold_noise
        slope = np.sqrt(variance) / np.sqrt(4 * (256**2 - 1) / 12)
        base = F(level - 510 * slope)
        threshold = base + F(slope) * F(first[p])
        held = phases[p] * threshold
        share, x = F(1), int(generators[p])
        for t in range(len(index)):
            charge = pattern.dark[row, column]
            for g in range(stack.shape[0]):
                near = stack[g, index[t], row, column] * pattern.response[row, column]
                next_knot = min(index[t] + 1, stack.shape[1] - 1)
                far = stack[g, next_knot, row, column] * pattern.response[row, column]
                charge += F(gain[t, g] * (1 - fraction[t])) * near + F(gain[t, g] * fraction[t]) * far
            held += share * charge
            share = F(1)
            x ^= (x << 13) & MASK
            x ^= x >> 17
            x ^= (x << 5) & MASK
            if held >= threshold:
                spikes[t, row, column] = 1
                most = F(level * sensor.kept_thresholds) if sensor.reset == "subtract" else F(0)
                held = min(held - threshold, most)
                share = F(1 - (1.0 if sensor.saturation == "dead_readout" else sensor.reset_loss))
                total = sum(((x + words[t]) & MASK).to_bytes(4, "little"))
                threshold = (
                    base + F(slope) * F(total) if normal is None else F(level + variance**0.5 * normal())
                )
    return spikes


def split_mix(key: int, count: int) -> int:
    """Low 32 bits of the SplitMix64 finaliser of key + count·golden ratio."""
    z = (key + count * 0x9E3779B97F4A7C15) & (2**64 - 1)
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & (2**64 - 1)
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & (2**64 - 1)
    return (z ^ (z >> 31)) & MASK
