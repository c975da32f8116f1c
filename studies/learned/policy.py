"""A policy that commands the lens: ``--method structure_calibrated+studies/learned/policy.py:Policy``.

Trained by train_policy.py; data, figures and limits are in policy.md.
"""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from saf_gen.core.onnx_network import OnnxNetwork
from saf_gen.parts import Answer, View

PERIOD_S, PACKET = 0.005, 8
"""Seconds between two commands, and the frames that a running camera hands over at once."""
SECOND = "sd_calibrated"
"""The focus measure in addition to that of the method: its peak is low and wide, and visible from far away."""
STEPS = 0.02, 0.06, 0.18
"""Sizes of the steps of the lens to either side, as fractions of the travel."""
ACTIONS = 3 + 2 * len(STEPS)
"""Number of actions: answer with the peak, go to the peak, stay, and the steps forward and backward."""
CELLS, SMEAR = 100, 0.03
"""Cells of the travel in which scores are averaged, and the motion in a window, in travels, that halves its weight."""
OFFSETS = np.array([-0.5, -0.3, -0.18, -0.1, -0.06, -0.03, 0.03, 0.06, 0.1, 0.18, 0.3, 0.5])
"""Distances from the peak, in travels, at which the network sees the curves."""
FEATURES = 3 * len(OFFSETS) + 11


def count_period_frames(readout_hz: float) -> int:
    """Return the frames of a control period, rounded up to complete packets as in the environment."""
    return max(-(-round(PERIOD_S * readout_hz) // PACKET), 1) * PACKET


class Explorer:
    """The scores that a lens has seen along its travel so far, and the state of its commands.

    The training environment and the search share this class, so that both see the same.

    Parameters
    ----------
    ends : tuple of float, default (0, 1)
        Ends of the travel, which the training moves inwards.
    mirrored : bool, default False
        Whether the network sees the two directions of the travel exchanged.
    """

    def __init__(self, *, ends: tuple[float, float] = (0.0, 1.0), mirrored: bool = False) -> None:
        self.ends, self._sign = ends, -1.0 if mirrored else 1.0
        self.target = self.here = self.smear = self.turns = 0.0
        self.direction, self.periods = 0.0, 0
        self.left, self._period, self.light = 1.0, 0.0, 0.0
        self._latest = np.zeros(2)
        self._weight, self._place, self._scores = np.zeros(CELLS), np.zeros(CELLS), np.zeros((CELLS, 2))

    def look(self, lens: float, *, left: float, light: float, scores: tuple[float, float]) -> None:
        """Add the observations of a control period.

        Parameters
        ----------
        lens : float
            Lens position at the end of the period.
        left : float
            Fraction of the time that is left.
        light : float
            Counts per pixel and frame.
        scores : tuple of float
            Scores of the method's measure and of ``SECOND``.
        """
        if not self.periods:
            self.here = self.target = lens
            self._period = 1 - left
        middle, self.smear, self.here = (self.here + lens) / 2, abs(lens - self.here), lens
        self.left, self.light = left, light
        self._latest = np.array(scores, float)
        self.periods += 1
        cell = min(int(middle * CELLS), CELLS - 1)
        weight = 1 / (1 + (self.smear / SMEAR) ** 2)
        self._weight[cell] += weight
        share = weight / self._weight[cell]
        self._place[cell] += share * (middle - self._place[cell])
        self._scores[cell] += share * (self._latest - self._scores[cell])

    @property
    def must_answer(self) -> bool:
        """True if no complete period is left after the next one."""
        return self.left < 2.01 * self._period

    def list_scores(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the positions at which the lens was seen, in increasing order, and their scores, (n,) and (n, 2)."""
        known = np.flatnonzero(self._weight)
        return self._place[known], self._scores[known]

    def find_peak(self) -> float:
        """Return the position of the peak of the method's scores.

        It is the vertex of a parabola through the logarithms of the scores round the best cell, limited to the
        neighbours of that cell.
        """
        known = np.flatnonzero(self._weight)
        place, score = self._place[known], self._scores[known, 0]
        best = int(score.argmax())
        if score[best] <= 0:
            return float(place[best])
        high = score > 0.5 * score[best]
        first = best - int(np.argmin(np.r_[high[best::-1], False])) + 1
        stop = best + int(np.argmin(np.r_[high[best:], False]))
        x, y = place[first:stop] - place[best], np.log(score[first:stop] / score[best])
        if len(x) < 3:
            return float(place[best])
        weight = np.sqrt(self._weight[known][first:stop]) * np.exp(y)
        square, slope, _ = np.linalg.lstsq(np.stack([x**2, x, x**0], 1) * weight[:, None], y * weight, rcond=None)[0]
        if square >= 0:
            return float(place[best])
        top = place[best] - slope / (2 * square)
        return float(np.clip(top, place[max(best - 1, 0)], place[min(best + 1, len(place) - 1)]))

    def describe(self) -> np.ndarray:
        """Return the input of the network, float32 (FEATURES,), which does not show where in its travel the lens is."""
        place, scores = self.list_scores()
        peak, sign = self.find_peak(), self._sign
        at = peak + sign * OFFSETS
        most = scores.max(axis=0)
        ratio = np.where(most > 0, np.clip(scores, 0, None) / np.where(most > 0, most, 1), 0) - 1
        latest = np.where(most > 0, np.clip(self._latest, 0, None) / np.where(most > 0, most, 1), 0) - 1
        seen = (at > place[0] - 0.01) & (at < place[-1] + 0.01)
        outside = (at < self.ends[0]) | (at > self.ends[1])
        curves = [np.where(outside, -1, np.where(seen, np.interp(at, place, each), 0)) for each in ratio.T]
        rest = (
            4 * sign * (self.here - peak),
            4 * sign * (self.target - self.here),
            4 * sign * (self.target - peak),
            sign * self.direction,
            10 * self.smear,
            self.left,
            *latest,
            math.log(self.light + 1e-3) / 4 + 0.7,
            float(ratio[:, 0].min()),
            min(self.turns, 4) / 4,
        )
        return np.concatenate([*curves, seen | outside, np.clip(rest, -2, 2)]).astype(np.float32)

    def find_step(self, number: int, side: float) -> int:
        """Return the action that moves the lens by STEPS[number] towards a side of the travel, 1 or -1."""
        return 3 + 2 * number + (side * self._sign < 0)

    def command(self, action: int) -> tuple[float, bool]:
        """Return the position to which an action sends the lens, and whether that is the answer."""
        stop = action == 0 or self.must_answer
        to = self.target
        if stop or action == 1:
            to = self.find_peak()
        elif action > 2:
            number, back = divmod(action - 3, 2)
            to += self._sign * STEPS[number] * (1 - 2 * back)
        to = float(np.float32(min(max(to, self.ends[0]), self.ends[1])))  # the environment rounds to float32
        if to != self.target:
            direction = math.copysign(1, to - self.target)
            self.turns += self.direction == -direction
            self.direction, self.target = direction, to
        return to, stop


@dataclass(frozen=True)
class Policy:
    """Commands the lens every 5 ms by a small network, which was trained in the Gymnasium environment.

    The network sees, round the best position so far, the curves of the method's measure and of a second measure over
    the part of the travel that the lens has passed; the position and motion of the lens relative to that position; the
    light; and the time that is left. It chooses one of nine actions: a step of 0.02, 0.06 or 0.18 of the travel to
    either side, stay, go to the peak, or answer with it. The peak is the vertex of a parabola through the logarithms of
    the scores round the best one. If only one more period is left, the search answers with the peak.

    It was trained with the measure ``structure_calibrated``, the actuator ``voice_coil_hall`` and a budget of 0.2 s.
    The trace holds the positions to which the lens was sent.
    """

    weights: str = "policy.onnx"
    version: str = field(init=False, default="")

    commands: ClassVar[bool] = True
    causal: ClassVar[bool] = True
    measures: ClassVar[tuple[str, ...]] = (SECOND,)
    source: ClassVar[str] = "This project: studies/learned/policy.md"

    def __post_init__(self) -> None:
        object.__setattr__(self, "version", self._network().version)

    def _network(self) -> OnnxNetwork:
        return OnnxNetwork(Path(__file__).parent / self.weights)

    def __call__(self, view: View) -> Answer:
        """Search with the lens of ``view``; raise BadInput for a recording, whose lens cannot be moved."""
        network, explorer, trace = self._network(), Explorer(), []
        period = count_period_frames(view.readout_hz)
        if view.frames < 2 * period:
            return Answer(None, (), "no time to look twice")
        while True:
            view.wait(period)
            explorer.look(**self._see(view, period, explorer.target))
            (worth,) = network(seen=explorer.describe()[None])
            to, stop = explorer.command(int(worth[0].argmax()))
            trace.append(to)
            if stop:
                return Answer(None, tuple(trace), f"after {explorer.periods} control periods", position=to)
            view.move(to)

    def _see(self, view: View, period: int, target: float) -> dict[str, Any]:
        """Return the latest period as the environment shows it, in float32.

        ``target`` is used as the lens position if the lens cannot be read.
        """
        first, stop = view.now - period, view.now
        lens = view.position(stop - 1)
        return {
            "lens": float(np.float32(target if math.isnan(lens) else min(max(lens, 0.0), 1.0))),
            "left": float(np.float32(1 - stop / view.frames)),
            "light": float(np.float32(view.counts(first, stop).mean() / period)),
            "scores": (view.score(first, stop), view.score(first, stop, SECOND)),
        }
