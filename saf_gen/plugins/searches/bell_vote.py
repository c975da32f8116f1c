"""Bells in the focus curves of a picture and its blocks: the focus at which they agree."""

from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

import numpy as np

from saf_gen.core.block_structure import block_edges, block_structure
from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._light_windows import equal_light_windows
from saf_gen.plugins.searches._windows import check_frame_count, check_numbers

SHORTEST = 4
"""Frames of the shortest step; a short recording has fewer steps."""
FEWEST = 3
"""Windows that a sweep needs for an answer."""
PLACES = 200
"""Places along the passed range of the lens at which a focus is looked for."""
WIDTHS = np.geomspace(0.01, 0.18, 8)
"""Widths of bells, as fractions of the passed range. In ``fine_structure``, that of a flat target is 1.2 to 2.4 depths
of focus."""
NOISE = 0.1
"""Share of the variance of a curve that no bell has to explain; it bounds the vote of a block."""
SURE, ELSEWHERE = 40.0, 0.3
"""Sharpness of the vote of a block, and the probability that it shows something else, with ``area``."""
NEAR = 0.05
"""Largest distance between the place of a block and an answer that agree, as a fraction of the passed range."""
FIRST, LOOK, LEAST = 20, 10, 0.04
"""Windows before the first look at the answer so far, and between two; and the part of the travel that the lens must
have passed by then."""


class Look(NamedTuple):
    """The answer of the windows so far, the share of the blocks that agree, and whether the lens is a width past it."""

    frame: float
    share: float
    passed: bool


@dataclass(frozen=True)
class BellVote:
    """Answers with the lens position at which bells explain most of the focus curves of the picture and of its blocks.

    A focus curve over the lens position x is a bell, y = a/(1 + ((x − x₀)/w)²)², above a floor. Noise, drifting light
    and whatever leaks into the box from around it are not. Windows have equal light, as in ``peak_fit``: after each of
    ``steps`` steps, the window that ends there is the shortest one with ``counts`` spikes per pixel, but no longer than
    the fraction ``longest`` of the recording. A recording with fewer than four frames per step has fewer steps. The
    picture in each window is scored by the method's measure, and by ``fine_structure`` in blocks of about ``block`` ×
    ``block`` pixels.

    For each place x₀ in the range that the lens passed, and for each of eight widths w, the correlation r of a curve
    with the bell gives the evidence −log(1 − r² + 0.1); a curve that falls to the place has none. The answer is the
    place of the largest sum of the mean evidence of the blocks and ``own`` times that of the picture, at the width that
    suits them all. So every block of a target counts alike, noise counts little, and each frame of the sweep is used.

    If a box shows several depths, this is the focus of its strongest contrast. With ``area``, it is the focus of most
    of its area instead: each block has its own width, its evidence becomes a probability of places, and the answer is
    the most probable place if each block shows something else with probability 0.3. The picture as a whole has no vote.

    A block agrees with the answer if the place of its own largest evidence is within a twentieth of the passed
    range, or half the width. Unless ``enough`` is 0, the sweep stops once this fraction of the blocks agrees and
    the lens is a width past the answer: 0.7 sees about two thirds of the frames, and loses one recording in a
    hundred. The search abstains if fewer than the fraction ``agree`` do, and the note states the share. Without a
    focus in the sweep it is smaller: 0.35 withdrew two thirds of such answers on training members, but one or two
    of eight on others, and one to eight right ones in a hundred.

    If lens positions are not recorded, frames are used in their place. The trace holds the frame of the answer.

    Raises BadInput for a recording of fewer than two frames, or an option out of range.

    References
    ----------
    This project. Bells: as ``peak_fit``.
    """

    counts: float = 12.0
    steps: int = 200
    longest: float = 0.15
    block: int = 10
    own: float = 0.3
    area: bool = False
    enough: float = 0.0
    agree: float = 0.0

    def __post_init__(self) -> None:
        check_frame_count("steps", self.steps)
        check_frame_count("block", self.block)
        check_numbers(self, {"counts": 1e6, "longest": 1.0, "own": 1e6, "enough": 1.0, "agree": 1.0})
        if not isinstance(self.area, bool):
            raise BadInput(f"area is {self.area!r}", allowed="true, false")

    @property
    def causal(self) -> bool:
        """Whether the search can stop before the sweep ends."""
        return self.enough > 0

    def __call__(self, view: View) -> Answer:
        """Return the answer for a sweep."""
        steps = max(min(self.steps, view.frames // SHORTEST), 1)
        rows, curves = list[tuple[float, float]](), list[np.ndarray]()
        look = None
        for window in equal_light_windows(view, self.counts, steps=steps, longest=self.longest):
            counts = view.counts(window.first, window.stop).astype(np.int64)
            edges = block_edges(counts.shape[0], self.block), block_edges(counts.shape[1], self.block)
            frame, position = (window.first + window.stop - 1) / 2, view.position((window.first + window.stop) // 2)
            rows.append((frame, position if isfinite(position) else frame / view.frames))
            own = view.score(window.first, window.stop)
            curves.append(np.append(block_structure(counts, edges), own))
            look = None
            if self.enough and len(rows) >= FIRST and len(rows) % LOOK == 0:
                look = self._look(np.array(rows), np.array(curves))
                if look and look.share >= max(self.enough, self.agree) and look.passed:
                    break
        if len(rows) < FEWEST:
            return Answer(None, (), "too dark")
        look = look or self._look(np.array(rows), np.array(curves), least=0.0)
        if look is None:
            return Answer(None, (), "the lens rested")
        note = f"stopped after {view.now} of {view.frames} frames, {look.share:.0%} of the blocks agree"
        return Answer(None if look.share < self.agree else look.frame, (look.frame,), note)

    def _look(self, rows: np.ndarray, curves: np.ndarray, *, least: float = LEAST) -> Look | None:
        """Return the answer of n windows, or None if the lens passed no more than ``least`` of its travel.

        ``rows`` (n, 2) holds the frame and the lens position of each, and ``curves`` (n, block + 1) their scores.
        """
        frames, lens = rows.T
        if np.ptp(lens) <= least:
            return None
        places = np.linspace(lens.min(), lens.max(), PLACES)
        r = bell_correlation(curves, lens=lens, places=places)
        evidence = -np.log1p(NOISE - np.square(np.maximum(r, 0))) + np.log1p(NOISE)
        free, mean = evidence[..., :-1].max(axis=0), evidence[..., :-1].mean(axis=2)
        if self.area:
            vote = np.exp(SURE * (free - free.max(axis=0)))
            total = np.log(ELSEWHERE / PLACES + (1 - ELSEWHERE) * vote / vote.sum(axis=0)).sum(axis=1)
        else:
            total = (mean + self.own * evidence[..., -1]).max(axis=0)
        focus, width = vertex(places, total), WIDTHS[mean[:, total.argmax()].argmax()] * np.ptp(lens)
        near = max(NEAR * np.ptp(lens), width / 2)
        share = float(np.mean(abs(places[free.argmax(axis=0)] - focus) < near))
        return Look(frame_of(focus, lens=lens, frames=frames), share, bool(abs(lens[-1] - focus) > width))


def bell_correlation(curves: np.ndarray, *, lens: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the correlation of curves (n, m) over lens positions (n,) with bells at p ``places``, (width, p, m).

    A bell that is wider than it is far from its neighbours is nearly constant; 2 % of its square keep noise from
    standing out there. A curve that is constant correlates with nothing.
    """
    y = curves - curves.mean(axis=0)
    y /= np.maximum(np.sqrt(np.square(y).sum(axis=0)), 1e-12)
    r = np.empty((len(WIDTHS), len(places), curves.shape[1]))
    for k, width in enumerate(WIDTHS * np.ptp(lens)):
        bell = 1 / (1 + ((lens - places[:, None]) / width) ** 2) ** 2
        least = 0.02 * np.square(bell).sum(axis=1, keepdims=True)
        bell -= bell.mean(axis=1, keepdims=True)
        r[k] = bell / np.sqrt(np.square(bell).sum(axis=1, keepdims=True) + least) @ y
    return r


def vertex(x: np.ndarray, y: np.ndarray) -> float:
    """Return the top of the parabola through the largest of y (n,) at even x and its neighbours; at an end, that x."""
    k = int(y.argmax())
    if not 0 < k < len(y) - 1:
        return float(x[k])
    bend = y[k - 1] - 2 * y[k] + y[k + 1]
    return float(x[k] + (x[1] - x[0]) * (y[k - 1] - y[k + 1]) / (2 * bend)) if bend < 0 else float(x[k])


def frame_of(position: float, *, lens: np.ndarray, frames: np.ndarray) -> float:
    """Return the first frame at which the lens, at (n,) positions in n frames, passes ``position``."""
    side = np.sign(lens - position)
    k = int(np.argmax(side[:-1] * side[1:] <= 0))
    away = lens[k + 1] - lens[k]
    return float(frames[k] + (frames[k + 1] - frames[k]) * ((position - lens[k]) / away if away else 0.0))
