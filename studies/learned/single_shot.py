"""A network that commands the lens from two windows: ``--method sd+studies/learned/single_shot.py:SingleShot``.

Trained by train_single_shot.py; data, figures and limits are in single_shot.md.
"""

from dataclasses import dataclass, field
from itertools import combinations
from math import log
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from saf_gen.core.onnx_network import OnnxNetwork
from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._lens_commanding import (
    FocusSampler,
    LensCommandingSearch,
    OutOfFramesError,
    check_fraction,
)

CROP, CROPS = 64, 6
"""Pixels along the side of a crop, and the number of crops of the region that the network sees."""
CENTRES = np.linspace(-3.5, 3.5, 29)
"""Centres of the network's bins: arcsinh of the distance to the focus in depths of focus; 3.5 corresponds to 16.5."""
DEPTHS = np.geomspace(0.025, 0.16, 9)
"""Depths of focus that are considered, as fractions of the travel."""
USUAL_DEPTH, DEPTH_SPREAD = 0.06, 0.45
"""The expected depth of focus, as a fraction of the travel, and the standard deviation of its logarithm."""
PLACES = np.linspace(0, 1, 501)
"""Positions of the focus that are considered, as fractions of the travel."""
LEAST = 3e-3
"""Probability that is added to each bin, because a network may be wrong even if it is certain."""
DARK = 0.3
"""Spikes per pixel in half a window below which it is too dark for an answer."""

Halves = tuple[np.ndarray, np.ndarray]


def describe_window(halves: Halves) -> np.ndarray:
    """Return the input of the network for the two halves of a window, counts (h, w): float32 (CROPS, 2, CROP, CROP).

    The crops are spread over the region, and each half is divided by its mean over all crops. A region smaller than a
    crop is mirrored at its borders.
    """
    crops = np.stack([_crop(half) for half in halves], axis=1).astype(np.float32)
    return crops / np.maximum(crops.mean(axis=(0, 2, 3), keepdims=True), 1e-3)


def _crop(counts: np.ndarray) -> np.ndarray:
    missing = [max(CROP - n, 0) for n in counts.shape]
    if any(missing):
        counts = np.pad(counts, [(0, n) for n in missing], mode="symmetric")
    height, width = counts.shape
    rows, columns = (2, 3) if width >= height else (3, 2)
    tops, lefts = (np.linspace(0, n - CROP, k).astype(int) for n, k in ((height, rows), (width, columns)))
    return np.stack([counts[y : y + CROP, x : x + CROP] for y in tops for x in lefts])


def describe_distance(distance: float) -> float:
    """Return the input of the network for the distance between two lens positions, a fraction of the travel."""
    return log(max(distance, 0.005) / USUAL_DEPTH)


@dataclass
class Belief:
    """The probability of each position of the focus after several looks, from the network's output for each pair.

    Attributes
    ----------
    network : OnnxNetwork
        The network.
    at : list of float
        Lens position of each look.
    windows : list of ndarray
        Input of the network for each look.
    said : list of list of ndarray
        For each look, the logarithms of the probabilities of the bins from each pair that it is part of.
    """

    network: Any
    at: list[float] = field(default_factory=list)
    windows: list[np.ndarray] = field(default_factory=list)
    said: list[list[np.ndarray]] = field(default_factory=list)

    def add(self, position: float, window: np.ndarray) -> None:
        """Add a look, and run the network for each pair of it and an earlier look."""
        self.at.append(position)
        self.windows.append(window)
        self.said.append([])
        for pair in combinations(range(len(self.at)), 2):
            if pair[1] == len(self.at) - 1:
                near, far = sorted(pair, key=lambda n: self.at[n])
                pictures = np.concatenate([self.windows[near], self.windows[far]], axis=1)
                apart = describe_distance(self.at[far] - self.at[near])
                told = self.network(windows=pictures[None], apart=np.array([[apart]]))
                for number, chances in zip((near, far), told, strict=True):
                    self.said[number].append(np.log(chances[0] + LEAST))

    def weigh(self) -> np.ndarray:
        """Return the joint probability of DEPTHS and PLACES, (9, 501), which sums to 1.

        Each look counts once, through the mean over its pairs, because the pairs are not independent.
        """
        found = -0.5 * (np.log(DEPTHS / USUAL_DEPTH) / DEPTH_SPREAD)[:, None] ** 2 + np.zeros(len(PLACES))
        for position, said in zip(self.at, self.said, strict=True):
            if said:
                away = np.arcsinh((PLACES - position) / DEPTHS[:, None])
                found += np.interp(away, CENTRES, np.mean(said, axis=0))
        found = np.exp(found - found.max())
        return found / found.sum()

    def find_focus(self) -> tuple[float, float]:
        """Return the most likely focus position, and the probability that the focus is within half a depth of it."""
        chances = self.weigh()
        depth = float(chances.sum(axis=1) @ DEPTHS)
        places = chances.sum(axis=0)
        near = np.abs(PLACES[:, None] - PLACES) <= depth / 2
        mass = near @ places
        best = int(mass.argmax())
        return float(np.average(PLACES[near[best]], weights=places[near[best]])), float(mass[best])


class _Looker:
    """A view whose scores are 0, and which keeps the counts of both halves of the last window in ``halves``."""

    def __init__(self, view: View) -> None:
        self._view = view
        self.halves: Halves = np.zeros((1, 1)), np.zeros((1, 1))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._view, name)

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        middle = (first + stop) // 2
        self.halves = self._view.counts(first, middle), self._view.counts(middle, stop)
        return 0.0


@dataclass(frozen=True)
class SingleShot(LensCommandingSearch):
    """Looks at two windows a ``step`` of the travel apart, from which a network estimates the distance to the focus.

    The second look is towards the longer part of the travel. The lens is then sent to the most likely position of the
    focus for another look, and so on, until the focus is within half a depth of focus of that position with a
    probability of ``sure``, after at least three and at most ``looks`` looks. The answer is the last such position.

    A small convolutional network sees crops of the counts of two windows, and the distance that the lens moved between
    them. It does not see the position of the lens in its travel, and the lens need not be known: for each look it gives
    a distribution over signed distances in depths of focus. The search combines the distributions of all pairs of looks
    into a joint probability of the focus position and the depth of focus. The method's measure is not used.

    The search answers with a lens position, and abstains if there is too little light or time for two looks. The trace
    holds the positions of all looks.
    """

    dt: int = 200
    step: float = 0.1
    looks: int = 7
    sure: float = 0.8
    weights: str = "single_shot.onnx"
    version: str = field(init=False, default="")

    source: ClassVar[str] = "This project, studies/learned/single_shot.md, after Herrmann et al., arXiv:2004.12260"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fraction("step", self.step)
        if not isinstance(self.looks, int) or self.looks < 3:
            raise BadInput(f"looks is {self.looks!r}", allowed="a whole number, 3 or more")
        if not 0 < self.sure < 1:
            raise BadInput(f"sure is {self.sure!r}", allowed="above 0, below 1")
        object.__setattr__(self, "version", self._network().version)

    def _network(self) -> OnnxNetwork:
        return OnnxNetwork(Path(__file__).parent / self.weights)

    def __call__(self, view: View) -> Answer:
        """Search with the lens of ``view``; raise BadInput for a recording, whose lens cannot be moved."""
        looker, belief = _Looker(view), Belief(self._network())
        look = FocusSampler(looker, self.dt, still=self.still, lag_s=self.lag_s, timeout_s=self.timeout_s)
        note, lit = "out of frames", False
        try:
            to = look.read_start()
            step = self.step if to <= 0.5 else -self.step
            for number in range(1, self.looks + 1):
                look(to)
                lit = lit or min(half.mean() for half in looker.halves) >= DARK
                belief.add(look.trace[-1], describe_window(looker.halves))
                if number == 1:
                    to += step
                    continue
                to, chance = belief.find_focus()
                if number >= 3 and chance >= self.sure:
                    break
            note = f"{number} looks"
        except OutOfFramesError:
            pass
        trace = tuple(look.trace)
        if len(trace) < 2:
            return Answer(None, trace, f"{note} before the second look")
        if not lit:
            return Answer(None, trace, "too dark")
        return Answer(None, trace, note, position=to)
