"""Exhaustive search: the best of all blocks of a recording."""

from dataclasses import dataclass
from typing import ClassVar

from saf_gen.errors import BadInput, closest
from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._windows import check_frame_count, check_windows_fit, score_windows

REFINE = ("no", "parabola", "centroid")


@dataclass(frozen=True)
class Argmax:
    """Scores consecutive blocks of ``window`` frames, and answers with the centre of the best.

    A last, incomplete block is left out, and the first of equal blocks wins. The search takes one score per block.

    ``refine`` selects how the maximum is located between blocks. With ``no``, it is the centre of the best block. With
    ``parabola``, it is the vertex of the parabola through the best block and its neighbours, at most half a block away.
    With ``centroid``, it is the mean frame of the contiguous blocks around the best that score above
    max − ``near``·(max − min), each weighted by its score above that level. The centroid averages more of the curve, so
    noise changes it less, but on an asymmetric curve it is shifted to the flatter side.

    A best block at an end of the recording has only one neighbour and is not refined. If the blocks of the centroid
    reach an end of the recording, the level is raised to the score there, because otherwise the other side would pull
    the answer inwards. ``near``, above 0 and at most 1, applies to the centroid only; its default was not tuned. The
    trace holds the centre of the best block before refinement, in frames from 0.

    References
    ----------
    .. [1] Exhaustive search. The released code of Su et al., "Intensity-Robust Autofocus for Spike Camera",
       CVPR 2024, doi:10.1109/CVPR52733.2024.02363, has the same blocks and prints their last frame.
    .. [2] The centroid follows "Spike Camera Autofocus via Frequency-Domain Spectral-Centroid Migration",
       ICML 2026, icml.cc/virtual/2026/poster/65044.
    """

    window: int = 100
    refine: str = "no"
    near: float = 0.5

    causal: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_frame_count("window", self.window)
        if self.refine not in REFINE:
            renamed = {"True": "parabola", "False": "no"}  # refine used to be a switch
            nearest = renamed.get(str(self.refine)) or closest(self.refine, REFINE)
            raise BadInput(f"refine is {self.refine!r}", allowed=", ".join(REFINE), nearest=nearest)
        number = isinstance(self.near, int | float) and not isinstance(self.near, bool)
        if not (number and 0 < self.near <= 1):
            raise BadInput(f"near is {self.near!r}", allowed="a fraction of the curve's range, above 0, at most 1")

    def __call__(self, view: View) -> Answer:
        """Return the answer for a recording; raise BadInput if it is shorter than one block."""
        check_windows_fit(view, "window", frames=self.window)
        firsts, scores = score_windows(view, self.window, step=self.window)
        best = scores.index(max(scores))
        centre = firsts[best] + (self.window - 1) / 2
        return Answer(centre + self._offset(scores, best) * self.window, (centre,))

    def _offset(self, scores: list[float], best: int) -> float:
        """Return the distance from the centre of the best block to the refined maximum, in blocks."""
        if self.refine == "parabola" and best > 0:
            return _parabola_vertex(scores[best - 1 : best + 2])
        return _centroid(scores, best, near=self.near) if self.refine == "centroid" else 0.0


def _parabola_vertex(scores: list[float]) -> float:
    """Return the top of the parabola through three scores, in blocks from the middle one.

    Returns 0.0 if there are fewer than three scores, or if the parabola has no top.
    """
    if len(scores) < 3:
        return 0.0
    before, here, after = scores
    bend = before - 2 * here + after
    return (before - after) / (2 * bend) if bend < 0 else 0.0


def _centroid(scores: list[float], best: int, *, near: float) -> float:
    """Return the centroid of the scores near the largest, in blocks from the best; 0.0 for a flat curve."""
    level = scores[best] - near * (scores[best] - min(scores))
    for end in {0, len(scores) - 1} & set(_blocks_above(scores, best, level=level)):
        level = max(level, scores[end])
    weights = {block: scores[block] - level for block in _blocks_above(scores, best, level=level)}
    total = sum(weights.values())
    return sum((block - best) * weight for block, weight in weights.items()) / total if total else 0.0


def _blocks_above(scores: list[float], best: int, *, level: float) -> range:
    """Return the contiguous blocks around the best that score above ``level``."""
    first, stop = best, best
    while first > 0 and scores[first - 1] > level:
        first -= 1
    while stop < len(scores) and scores[stop] > level:
        stop += 1
    return range(first, stop)
