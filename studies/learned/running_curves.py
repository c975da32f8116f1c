"""A network over running curves: ``--method structure_calibrated+studies/learned/running_curves.py:RunningCurves``.

Trained by train_running_curves.py; data, figures and limits are in running_curves.md.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import log
from pathlib import Path
from typing import ClassVar

import numpy as np

from saf_gen.core.onnx_network import OnnxNetwork
from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View

STEPS = 100
"""Steps into which a recording of any length is divided; the network was built for this number."""
COUNTS, LONGEST = 8.0, 0.15
"""Spikes per pixel that end the extension of a window, and the longest window as a fraction of the recording."""
MEASURES = "sd_calibrated", "vollath_f4_n", "gradient_code_n"
FRAME, POSITION, LIGHT, SPIKES, WIDTH, SCORES = 0, 1, 2, 3, 4, slice(5, 9)
"""Columns of the rows that :func:`follow_sweep` yields."""
NEAR = 2
"""Steps on both sides of the most likely window over which the answer is averaged."""


def follow_sweep(view: View) -> Iterator[np.ndarray]:
    """Yield all rows so far, (n, 9), after each of the STEPS steps; each row describes the window that ends there.

    A window is the shortest that ends at the step and has COUNTS spikes per pixel, but at most LONGEST of the
    recording. If it has fewer than a quarter of COUNTS, nothing is yielded for the step. Raises BadInput if a step has
    fewer than two frames.
    """
    step = view.frames // STEPS
    if step < 2:
        raise BadInput(
            f"a recording of {view.frames} frames is too short for {STEPS} steps",
            allowed=f"at least {2 * STEPS} frames",
            hint="record longer, or sweep more slowly",
        )
    spikes, rows = [0.0], np.zeros((STEPS, 9))
    known = 0
    for k in range(1, STEPS + 1):
        stop = k * step
        spikes.append(spikes[-1] + float(view.counts(stop - step, stop).mean()))
        begin = k - 1
        while begin > max(k - LONGEST * STEPS, 0) and spikes[k] - spikes[begin] < COUNTS:
            begin -= 1
        counted, first = spikes[k] - spikes[begin], begin * step
        if counted < COUNTS / 4:
            continue
        middle = (first + stop) // 2
        position = view.position(middle)
        light = log((spikes[k] - spikes[k - 1] + 1e-3) / step)
        scores = [view.score(first, stop), *(view.score(first, stop, name) for name in MEASURES)]
        rows[known] = [
            *((first + stop - 1) / 2, k / STEPS if np.isnan(position) else position),
            *(light, counted, (k - begin) / STEPS, *scores),
        ]
        known += 1
        yield rows[:known]


def describe_curves(rows: np.ndarray) -> np.ndarray:
    """Return the input of the network for rows (n, 9): float32 (13, STEPS), with zeros after the n-th column.

    The channels are the curves, scaled to 0 to 1; the relative size of their ranges; light, and spikes in the window;
    the distance of the lens from its present position; the width of the window; and 1 if there is a row. The position
    of the lens in its travel is left out, because each of the few training scenes has its focus at one position, which
    a network would memorise.
    """
    n = len(rows)
    seen = np.zeros((13, STEPS), np.float32)
    scores = rows[:, SCORES]
    least, most = scores.min(axis=0), scores.max(axis=0)
    span, size = most - least, np.maximum(abs(most), abs(least))
    seen[0:4, :n] = ((scores - least) / np.where(span > 0, span, 1)).T
    seen[4:8, :n] = (span / np.where(span > 0, np.maximum(size, span), 1))[:, None]
    seen[8, :n] = (rows[:, LIGHT] - rows[:, LIGHT].mean()) / 2
    seen[9, :n] = np.log(rows[:, SPIKES] / COUNTS) / 2
    seen[10, :n] = 4 * abs(rows[:, POSITION] - rows[-1, POSITION])
    seen[11, :n] = rows[:, WIDTH] / LONGEST
    seen[12, :n] = 1
    return seen


def find_focus_frame(rows: np.ndarray, likely: np.ndarray) -> float:
    """Return the mean frame round the most likely of rows (n, 9), weighted by their probabilities, (n,)."""
    best = int(likely.argmax())
    near = slice(max(best - NEAR, 0), best + NEAR + 1)
    return float(np.average(rows[near, FRAME], weights=likely[near] + 1e-9))


@dataclass(frozen=True)
class RunningCurves:
    """Follows a sweep by a one-dimensional network over the curves so far, and stops once the focus has been passed.

    After each hundredth of the recording, a small convolutional network sees the curves of the method's measure and of
    three others, the light and the lens positions up to then. It gives the probability that the focus is in each of the
    windows so far, and the probability that it has not been passed yet. If the latter is below 1 − ``sure`` for two
    steps, the sweep stops, and the answer is the mean frame round the most likely window. If the recording ends first
    and the focus was probably not in it, the search abstains. Nothing after the last window is used.

    It was trained with the measure ``structure_calibrated``; with another measure the first curve is unlike those of
    the training. The trace holds the frame of the most likely window, each time it changes.
    """

    sure: float = 0.9
    weights: str = "running_curves.onnx"
    version: str = field(init=False, default="")

    causal: ClassVar[bool] = True
    measures: ClassVar[tuple[str, ...]] = MEASURES
    source: ClassVar[str] = "This project: studies/learned/running_curves.md"

    def __post_init__(self) -> None:
        if not 0 < self.sure < 1:
            raise BadInput(f"sure is {self.sure!r}", allowed="above 0, below 1")
        object.__setattr__(self, "version", self._network().version)

    def _network(self) -> OnnxNetwork:
        return OnnxNetwork(Path(__file__).parent / self.weights)

    def __call__(self, view: View) -> Answer:
        """Search the sweep; raise BadInput if it is too short."""
        network, trace, passed = self._network(), [], 0
        rows, likely = np.zeros((0, 9)), np.zeros(0)
        for rows in follow_sweep(view):
            (found,) = network(curves=describe_curves(rows)[None])
            likely = found[0, : len(rows)]
            frame = float(rows[likely.argmax(), FRAME])
            if not trace or trace[-1] != frame:
                trace.append(frame)
            passed = passed + 1 if found[0, -1] < 1 - self.sure else 0
            if passed == 2:
                break
        note = f"stopped after {view.now} of {view.frames} frames"
        if not len(rows):
            return Answer(None, (), "too dark")
        if likely.sum() < 0.5:
            return Answer(None, tuple(trace), f"{note}: no focus in it")
        return Answer(find_focus_frame(rows, likely), tuple(trace), note)
