"""A search's view of a sweep whose focus curve, light and lens positions are known."""

import numpy as np

from saf_gen.core.seeds import make_generator


class Sweep:
    """A recording with a focus curve over frames, lit by ``light``; records the windows that were scored.

    ``lens`` holds the lens position at each frame; if it is missing, the lens position is unknown. ``light`` includes
    ``dark`` spikes per pixel and frame, which lower contrast and scores. ``broad`` and ``finest`` are the curves of two
    measures that a search names; the first is calibrated, so that dark spikes do not lower its scores.
    """

    readout_hz = 20_000.0

    def __init__(self, curve, light=None, *, noise=0.0, broad=None, finest=None, lens=None, dark=0.0):
        self.frames, self.lens = len(curve), lens
        self.curve, self.noise, self.dark = curve, noise, dark
        self.named = {"sd_calibrated": broad, "vollath_f4_n": finest}
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
        curve = self.curve if self.named.get(measure) is None else self.named[measure]
        value = float(np.average(curve[first:stop], weights=self.light[first:stop] + 1e-12))
        if self.dark and measure != "sd_calibrated":
            value *= (1 - self.dark * (stop - first) / count) ** 2
        return value + self.noise * float(make_generator("sweep", first, stop).standard_normal()) / np.sqrt(
            count + 1e-12
        )

    def counts(self, first, stop):
        """Return counts of a board of 4 × 4 fields, half of them three times as bright as the others."""
        self.now = max(self.now, stop)
        dark = self.dark * (stop - first)
        lit = self.spikes[stop] - self.spikes[first] - dark
        return dark + lit * np.where(np.indices((4, 4)).sum(axis=0) % 2, 1.5, 0.5)

    def polarities(self, first, stop):
        """Return the events of 4 × 4 pixels, of which the brighter half follows the curve: falls, then rises."""
        self.now = max(self.now, stop)
        change = 1e6 * (self.curve[stop - 1] - self.curve[first])
        events = np.array([max(-change, 0.0), max(change, 0.0)]).astype(np.uint32)
        return events[:, None, None] * (np.indices((4, 4)).sum(axis=0) % 2).astype(np.uint32)

    def position(self, frame):
        return float("nan") if self.lens is None else float(self.lens[frame])
