"""Exhaustive search over windows of equal light: the best of windows that hold equally many spikes."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput, closest
from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._light_windows import equal_light_windows
from saf_gen.plugins.searches._windows import check_frame_count, check_numbers

REFINE = ("no", "parabola", "centroid")


@dataclass(frozen=True)
class ArgmaxLight:
    """Scores windows of equal light along the whole recording, and answers with the centre of the best.

    After each of ``steps`` steps of a recording, the window that ends there is the shortest one with ``counts`` spikes
    per pixel, but no longer than the fraction ``longest`` of the recording, as for ``peak_fit``. Noise is then alike in
    all windows, so no score is larger only because the light was dim, and windows are no longer than they need to be.
    This gives any measure the windows of this project's own searches.

    ``refine`` selects how the maximum is located between windows, from the contiguous windows around the best that
    score above max − ``near``·(max − min). With ``no``, it is the centre of the best window; with ``parabola``, the top
    of the parabola fitted to them by least squares, if they are at least four and have a top among them; with
    ``centroid``, their mean frame, each weighted by its score above that level.

    The search abstains if no window has a quarter of ``counts`` spikes. The trace holds the centre of the best window
    before refinement, in frames from 0.

    References
    ----------
    .. [1] Exhaustive search. Windows of a fixed number of events are common for event cameras: Gallego et al.,
       "Event-Based Vision: A Survey", TPAMI 44(1), 2022, doi:10.1109/TPAMI.2020.3008413.
    """

    counts: float = 12.0
    steps: int = 200
    longest: float = 0.1
    refine: str = "no"
    near: float = 0.3

    causal: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_frame_count("steps", self.steps)
        check_numbers(self, {"counts": 1e6, "longest": 1.0, "near": 1.0})
        for key in ("counts", "near"):
            if not getattr(self, key):
                raise BadInput(f"{key} is {getattr(self, key)!r}", allowed="a number above 0")
        if self.refine not in REFINE:
            raise BadInput(
                f"refine is {self.refine!r}", allowed=", ".join(REFINE), nearest=closest(self.refine, REFINE)
            )

    def __call__(self, view: View) -> Answer:
        """Return the answer for a recording; raise BadInput if it has fewer than two frames per step."""
        windows = list(equal_light_windows(view, self.counts, steps=self.steps, longest=self.longest))
        if not windows:
            return Answer(None, (), "too dark")
        scores = np.array([view.score(window.first, window.stop) for window in windows])
        centres = np.array([(window.first + window.stop - 1) / 2 for window in windows])
        best = int(scores.argmax())
        return Answer(self._refine(centres, scores, best=best), (float(centres[best]),))

    def _refine(self, centres: np.ndarray, scores: np.ndarray, *, best: int) -> float:
        """Return the frame of the maximum of a curve of n scores at ``centres`` (n,), whose largest is ``best``."""
        level = scores[best] - self.near * np.ptp(scores)
        low = np.flatnonzero(scores < level)
        near = slice(int(max(low[low < best], default=-1)) + 1, int(min(low[low > best], default=len(scores))))
        x, y = centres[near] - centres[best], scores[near] - level
        offset = 0.0
        if self.refine == "parabola" and len(np.unique(x)) >= 4:
            bend, slope, _ = np.polyfit(x, y, 2)
            top = -slope / (2 * bend) if bend < 0 else 0.0
            offset = top if x.min() <= top <= x.max() else 0.0
        elif self.refine == "centroid" and y.sum() > 0:
            offset = float(x @ y / y.sum())
        return float(centres[best] + offset)
