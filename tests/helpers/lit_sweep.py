"""A sweep whose focus curve, light and lens positions are known, as a search sees it."""

import numpy as np

from saf_gen.core.seeds import make_generator


class Sweep:
    """A recording with a focus curve over frames, lit by ``light``; notes the windows that were scored.

    ``lens`` holds the lens position at each frame; without it, nothing is known of the lens.
    """

    readout_hz = 20_000.0

    def __init__(self, curve, light=None, *, noise=0.0, broad=None, lens=None):
        self.frames, self.lens = len(curve), lens
        self.curve, self.noise, self.broad = curve, noise, curve if broad is None else broad
        self.light = np.full(self.frames, 0.2) if light is None else light
        self.spikes = np.concatenate([[0.0], np.cumsum(self.light)])
        self.windows, self.now = [], 0

    def score(self, first, stop, measure=None):
        assert 0 <= first < stop <= self.frames
        self.now = max(self.now, stop)
        count = self.spikes[stop] - self.spikes[first]
        if measure == "er_count":
            return 1000 * count
        if measure == "er_count_n":
            return 1000.0
        self.windows.append((first, stop, count))
        curve = self.broad if measure == "sd_calibrated" else self.curve
        value = float(np.average(curve[first:stop], weights=self.light[first:stop] + 1e-12))
        return value + self.noise * float(make_generator("sweep", first, stop).standard_normal()) / np.sqrt(
            count + 1e-12
        )

    def position(self, frame):
        return float("nan") if self.lens is None else float(self.lens[frame])
