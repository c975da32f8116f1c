"""Naive search: windows of a length chosen by hand, round any moment."""

from dataclasses import dataclass
from typing import ClassVar

from saf_gen.errors import BadInput
from saf_gen.parts import Answer, View
from saf_gen.searches._golden_narrowing import check_frame_count


@dataclass(frozen=True)
class Naive:
    """Scores a window of ``dt`` frames round every ``step``-th moment, and answers with the best moment.

    The first of the paper's three searches (section 4.3): the score at time t is that of t − Δt/2 ... t +
    Δt/2, and the focus is where it is largest. Windows overlap where ``step`` is less than ``dt``;
    consecutive blocks are ``argmax``. Only whole windows are scored, so it cannot answer within dt/2 of
    either end. Of equal windows the first wins. (frames − dt)/step + 1 scores. The trace holds the best
    moment, a frame from 0.
    """

    dt: int = 100
    step: int = 10

    causal: ClassVar[bool] = False
    source: ClassVar[str] = (
        "Su et al., Intensity-Robust Autofocus for Spike Camera, CVPR 2024, section 4.3, "
        "doi:10.1109/CVPR52733.2024.02363; after Lin et al., CVPR 2022, doi:10.1109/CVPR52688.2022.01586"
    )

    def __post_init__(self) -> None:
        check_frame_count(self.dt, "dt")
        check_frame_count(self.step, "step")

    def __call__(self, view: View) -> Answer:
        """Search the whole recording. Raises BadInput where it is shorter than one window."""
        if view.frames < self.dt:
            raise BadInput(
                f"a recording of {view.frames} frames is shorter than one window of {self.dt} frames",
                allowed=f"dt of 1 ... {view.frames}",
                hint="choose a smaller dt",
            )
        firsts = range(0, view.frames - self.dt + 1, self.step)
        scores = [view.score(first, first + self.dt) for first in firsts]
        centre = firsts[scores.index(max(scores))] + (self.dt - 1) / 2
        return Answer(centre, (centre,))
