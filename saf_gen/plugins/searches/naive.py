"""Best of overlapping windows: the naive search, whose windows have a fixed length."""

from dataclasses import dataclass
from typing import ClassVar

from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._windows import check_frame_count, check_windows_fit, score_windows


@dataclass(frozen=True)
class Naive:
    """Scores a window of ``dt`` frames every ``step`` frames, and answers with the centre of the best.

    This is the first of the three searches of Su et al.: the score at time t is the score of the window from t − Δt/2
    to t + Δt/2, and the focus is where it is largest. Windows overlap if ``step`` is less than ``dt``; ``argmax``
    searches consecutive blocks instead. Only complete windows are scored, so the answer cannot be within dt/2 of either
    end. The first of equal windows wins. The search takes (frames − dt)/step + 1 scores. The trace holds the answer.

    References
    ----------
    .. [1] Section 4.3 of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363.
    .. [2] Lin et al., "Autofocus for Event Cameras", CVPR 2022, doi:10.1109/CVPR52688.2022.01586.
    """

    dt: int = 100
    step: int = 10

    causal: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_frame_count("dt", self.dt)
        check_frame_count("step", self.step)

    def __call__(self, view: View) -> Answer:
        """Return the answer for a recording; raise BadInput if it is shorter than one window."""
        check_windows_fit(view, "dt", frames=self.dt)
        firsts, scores = score_windows(view, self.dt, step=self.step)
        centre = firsts[scores.index(max(scores))] + (self.dt - 1) / 2
        return Answer(centre, (centre,))
