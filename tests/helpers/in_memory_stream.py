"""A stream in memory, for tests of what a method sees."""

import numpy as np

from saf_gen.core import bits
from saf_gen.core.seeds import make_generator
from saf_gen.stream.pixel_mask import Filling


class InMemory:
    """A stream of random spikes with the members that a view uses; records what was counted and read."""

    readout_hz, focus_position = 20_000.0, None

    def __init__(self, frames, height, width, *, rate=0.3):
        self.shape = (frames, height, width)
        chance = make_generator("test_rig", frames, height, width).random(self.shape, dtype=np.float32)
        self.spikes = (chance < rate).astype(np.uint8)
        self.asked, self.read = [], []

    def filling(self, region):
        return Filling(None, region)

    def counts(self, first, stop, region, filled=True):
        self.asked.append((first, stop))
        return self.spikes[first:stop, *region].sum(axis=0, dtype=np.uint32)

    def packed(self, first_byte, stop_byte, region):
        self.read.append((first_byte, stop_byte))
        return bits.pack_bits(self.spikes[:, *region])[:, :, first_byte:stop_byte]
