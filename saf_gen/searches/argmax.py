"""Exhaustive search: the best of all blocks."""

from dataclasses import dataclass
from typing import ClassVar

from saf_gen.errors import BadInput, closest
from saf_gen.parts import Answer, View
from saf_gen.searches._golden_narrowing import check_frame_count

REFINE = ("no", "parabola", "centroid")


@dataclass(frozen=True)
class Argmax:
    """Scores consecutive blocks of ``window`` frames, and answers with the centre of the best.

    A last, partial block is left out, and of equal blocks the first wins. One score a block.
    ``refine`` says how the top is found between the blocks:

    ``no``: not at all. ``parabola``: the top of the parabola through the best block and its neighbours, at
    most half a block away. ``centroid``: the mean frame of the blocks round the best that score above
    max − ``near``·(max − min) without a gap, each weighted by what it scores above that level. More of the
    curve has a say, so noise moves it less; of a lopsided curve it leans to the flatter side.

    A best block at either end has one neighbour only and is not refined. Where the blocks of the centroid
    reach an end of the recording, the level is raised to the score there: the other side alone would pull it
    inwards. ``near``, above 0 to 1, counts for the centroid alone; 0.5 is tuned on nothing: tune it on train.
    The trace holds the centre of the best block, a 0-based frame, before refinement.
    """

    window: int = 100
    refine: str = "no"
    near: float = 0.5

    causal: ClassVar[bool] = False
    source: ClassVar[str] = (
        "exhaustive search; the released code of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363, has "
        "the same blocks and prints their last frame; centroid: after Spike Camera Autofocus via "
        "Frequency-Domain Spectral-Centroid Migration, ICML 2026 (icml.cc/virtual/2026/poster/65044)"
    )

    def __post_init__(self) -> None:
        check_frame_count(self.window, "window")
        if self.refine not in REFINE:
            was = {"True": "parabola", "False": "no"}  # it has been a switch
            nearest = was.get(str(self.refine)) or closest(self.refine, REFINE)
            raise BadInput(f"refine is {self.refine!r}", allowed=", ".join(REFINE), nearest=nearest)
        number = isinstance(self.near, int | float) and not isinstance(self.near, bool)
        if not (number and 0 < self.near <= 1):
            raise BadInput(
                f"near is {self.near!r}", allowed="a share of the curve's range, above 0, at most 1"
            )

    def __call__(self, view: View) -> Answer:
        """Search the whole recording. Raises BadInput where it is shorter than one block."""
        if view.frames < self.window:
            raise BadInput(
                f"a recording of {view.frames} frames is shorter than one window of {self.window} frames",
                allowed=f"window of 1 ... {view.frames}",
                hint="choose a smaller window",
            )
        firsts = range(0, view.frames - self.window + 1, self.window)
        scores = [view.score(first, first + self.window) for first in firsts]
        best = scores.index(max(scores))
        centre = firsts[best] + (self.window - 1) / 2
        return Answer(centre + self._shift(scores, best) * self.window, (centre,))

    def _shift(self, scores: list[float], best: int) -> float:
        """From the best block to the refined top, in blocks."""
        if self.refine == "parabola" and best > 0:
            return _vertex(scores[best - 1 : best + 2])
        return _centroid(scores, best, self.near) if self.refine == "centroid" else 0.0


def _vertex(scores: list[float]) -> float:
    """Top of the parabola through three scores, in blocks from the middle one; 0.0 for fewer or a line."""
    if len(scores) < 3:
        return 0.0
    before, here, after = scores
    bend = before - 2 * here + after
    return (before - after) / (2 * bend) if bend < 0 else 0.0


def _centroid(scores: list[float], best: int, near: float) -> float:
    """Centroid of the run of scores near the largest, in blocks from the best; 0.0 where none is above."""
    level = scores[best] - near * (scores[best] - min(scores))
    run = _run(scores, best, level)
    for end in {0, len(scores) - 1} & set(run):
        level = max(level, scores[end])
    weights = {block: scores[block] - level for block in _run(scores, best, level)}
    total = sum(weights.values())
    return sum((block - best) * weight for block, weight in weights.items()) / total if total else 0.0


def _run(scores: list[float], best: int, level: float) -> range:
    """The blocks round the best that score above the level without a gap."""
    first, stop = best, best
    while first > 0 and scores[first - 1] > level:
        first -= 1
    while stop < len(scores) and scores[stop] > level:
        stop += 1
    return range(first, stop)
