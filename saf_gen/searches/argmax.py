"""Exhaustive search: the best of all blocks."""

from dataclasses import dataclass
from typing import ClassVar

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.searches._golden import whole


@dataclass(frozen=True)
class Argmax:
    """Scores consecutive blocks of ``window`` frames, and answers with the centre of the best.

    A last, partial block is left out, and of equal blocks the first wins. With ``refine`` the answer is the
    top of the parabola through the best block and its neighbours, at most half a block away; a best block
    at either end has one neighbour only and is not refined. One score a block.
    The trace holds the centre of the best block, a 0-based frame, before refinement.
    """

    window: int = 100
    refine: bool = False

    causal: ClassVar[bool] = False
    source: ClassVar[str] = (
        "exhaustive search; the released code of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363, has "
        "the same blocks and prints their last frame"
    )

    def __post_init__(self) -> None:
        whole(self.window, "window")
        if not isinstance(self.refine, bool):
            raise BadInput(f"refine is {self.refine!r}", allowed="true, false")

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
        shift = _vertex(scores[best - 1 : best + 2]) if self.refine and best > 0 else 0.0
        return Answer(centre + shift * self.window, (centre,))


def _vertex(scores: list[float]) -> float:
    """Top of the parabola through three scores, in blocks from the middle one; 0.0 for fewer or a line."""
    if len(scores) < 3:
        return 0.0
    before, here, after = scores
    bend = before - 2 * here + after
    return (before - after) / (2 * bend) if bend < 0 else 0.0
