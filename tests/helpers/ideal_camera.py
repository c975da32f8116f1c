"""A running camera with an ideal lens, for tests of lens-commanding searches."""

import math

import numpy as np

from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput


class IdealCamera:
    """A saf_gen.parts.View of a running camera that scores a given focus curve instead of a scene.

    The lens moves at ``speed`` travels per second towards its command. A score is the mean of ``curve`` over
    the lens positions of the window, plus noise drawn per window. The position sensor has noise of rms
    ``sensor``, reads NaN if it is ``blind``, and misses a motion that falls to 1/e in ``lag_s``. Time passes in
    packets of 8 frames. ``others`` are the curves of named measures. ``positions`` holds the lens position at
    each frame so far, ``scored`` the windows, ``commands`` the targets.
    """

    def __init__(
        self,
        curve,
        *,
        start=0.0,
        frames=200_000,
        speed=5.0,
        noise=0.0,
        backlash=0.0,
        sensor=1e-4,
        blind=False,
        lag_s=0.016,
        others=None,
    ):
        self._curve, self._others = curve, others or {}
        self.frames, self.readout_hz = frames // 8 * 8, 20_000.0
        self.lag_s = lag_s
        self._step, self._backlash, self._blind = speed / self.readout_hz, backlash, blind
        self._command = start
        self._noise_source = make_generator("ideal_camera")
        self._noise, self._sensor = noise, sensor
        self.positions, self._read, self.scored, self.commands = [], [], [], []
        self._here, self._direction = start, 1

    @property
    def now(self):
        return len(self.positions)

    def move(self, to):
        assert math.isfinite(to)
        assert 0 <= to <= 1
        self.commands.append(to)
        self._direction = 1 if to > self._command else -1 if to < self._command else self._direction
        self._command = to

    def wait(self, frames):
        assert frames >= 0
        steps = np.arange(1, -(-int(frames) // 8) * 8 + 1)
        assert self.now + steps.size <= self.frames, "beyond the budget"
        if not steps.size:
            return
        target = min(max(self._command - self._direction * self._backlash / 2, 0.0), 1.0)
        distance = target - self._here
        path = self._here + math.copysign(1, distance) * np.minimum(self._step * steps, abs(distance))
        self._here = float(path[-1])
        self.positions += path.tolist()
        read = path + self._sensor * self._noise_source.normal(size=path.size)
        self._read += (np.full(path.size, math.nan) if self._blind else read).tolist()

    def position(self, frame):
        if not 0 <= frame < self.now:
            raise BadInput(f"frame {frame} has not passed")
        return self._read[frame]

    def score(self, first, stop, measure=None):
        assert isinstance(first, int)
        assert isinstance(stop, int)
        assert 0 <= first < stop <= self.frames
        self.wait(max(stop - self.now, 0))
        curve = self._curve if measure is None else self._others[measure]
        places, times = np.unique(self.positions[first:stop], return_counts=True)  # a lens at rest has one
        self.scored.append((first, stop, measure))
        score = float(np.average([curve(place) for place in places.tolist()], weights=times))
        return score + self._noise * self._noise_source.normal()


def bell_curve(peak, *, width=0.1, floor=0.3):
    """Return a focus curve of height 1 at ``peak``, with a floor, ``width`` to 1/e, and slowly falling tails."""
    return lambda p: (
        floor + (1 - floor) * (0.9 * math.exp(-(((p - peak) / width) ** 2)) + 0.1 / (1 + ((p - peak) / 0.3) ** 2))
    )
