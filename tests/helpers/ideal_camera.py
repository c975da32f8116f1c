"""A running camera with an ideal lens, for the tests of searches that command it."""

import math

import numpy as np

from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput


class IdealCamera:
    """Exactly what saf_gen.parts.View promises of a camera that is running, with a curve for a scene.

    The lens goes ``speed`` of the travel a second towards its command; a score is the mean of ``curve`` over
    where the lens was, plus noise of the window's own. Its sensor reads with the rms ``sensor``, NaN where it
    is ``blind``, and says that it does not see a motion that falls to 1/e in ``lag_s``. Time passes in
    packets of 8 frames. ``others`` are the curves of named measures.
    ``positions`` is where the lens was at each frame so far, ``scored`` what was scored.
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
        self._drawn = make_generator("ideal_camera")
        self._noise, self._sensor = noise, sensor
        self.positions, self._read, self.scored, self.commands = [], [], [], []
        self._here, self._way = start, 1

    @property
    def now(self):
        return len(self.positions)

    def move(self, to):
        assert math.isfinite(to)
        assert 0 <= to <= 1
        self.commands.append(to)
        self._way = 1 if to > self._command else -1 if to < self._command else self._way
        self._command = to

    def wait(self, frames):
        assert frames >= 0
        steps = np.arange(1, -(-int(frames) // 8) * 8 + 1)
        assert self.now + steps.size <= self.frames, "beyond the budget"
        if not steps.size:
            return
        target = min(max(self._command - self._way * self._backlash / 2, 0.0), 1.0)
        away = target - self._here
        went = self._here + math.copysign(1, away) * np.minimum(self._step * steps, abs(away))
        self._here = float(went[-1])
        self.positions += went.tolist()
        read = went + self._sensor * self._drawn.normal(size=went.size)
        self._read += (np.full(went.size, math.nan) if self._blind else read).tolist()

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
        places = self.positions[first:stop]
        self.scored.append((first, stop, measure))
        return math.fsum(curve(p) for p in places) / len(places) + self._noise * self._drawn.normal()


def bell_curve(peak, *, width=0.1, floor=0.3):
    """A focus curve: 1 at ``peak`` over a floor, width to 1/e; its tails still fall, however little."""
    return lambda p: (
        floor
        + (1 - floor) * (0.9 * math.exp(-(((p - peak) / width) ** 2)) + 0.1 / (1 + ((p - peak) / 0.3) ** 2))
    )
