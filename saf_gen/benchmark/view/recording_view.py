"""View of a recording for a method: its length, the lens positions, and the scores and counts of windows."""

from collections.abc import Callable

import numpy as np

from saf_gen.benchmark.view.metered_scorer import MeteredScorer
from saf_gen.benchmark.view.window_counts import WindowCounts
from saf_gen.core.region import validate_window
from saf_gen.errors import BadInput


class RecordingView:
    """The view of a recording for one method's search; see :class:`saf_gen.parts.View`.

    Parameters
    ----------
    counts : WindowCounts
        Counts of any window of the recording.
    measure : callable
        The method's own measure.

    Attributes
    ----------
    now : int
        End of the latest window that was scored or looked at.
    scores : dict of (int, int) to float
        Score of each window (first, stop) by the method's own measure.
    scorer : MeteredScorer
        Scorer that measures the cost.
    """

    lag_s = 0.0  # a recording stores the positions of the lens itself

    def __init__(self, counts: WindowCounts, measure: Callable[..., float]) -> None:
        self._counts, self.scorer = counts, MeteredScorer(measure)
        self.frames, self.readout_hz = counts.frames, counts.readout_hz
        self.now = 0
        self.scores: dict[tuple[int, int], float] = {}

    def position(self, frame: int) -> float:
        """Return the lens position, as a fraction of the travel, or NaN if it was not recorded.

        Raises BadInput if the frame is outside the recording.
        """
        window, lens = validate_window(frame, frame + 1, total=self.frames), self._counts.lens_position
        return float("nan") if lens is None else float(lens[window.start])

    def move(self, to: float) -> None:
        """Raise BadInput, because the lens of a recording cannot be moved."""
        raise _refuse_lens_command(f"be moved to {to:g}")

    def wait(self, frames: int) -> None:
        """Raise BadInput, because no time passes on a recording."""
        raise _refuse_lens_command(f"wait for {frames} frames")

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        """Return the score of frames ``first <= t < stop`` by the method's measure, or by the one named ``measure``.

        Raises BadInput if the window is empty or outside the recording, if the score is not a finite number, or if the
        measure is unknown.
        """
        window = validate_window(first, stop, total=self.frames)
        first, stop = window.start, window.stop
        score = self.scorer.score(self._counts, first=first, stop=stop, measure=measure)
        self.now = max(self.now, stop)
        if measure is None:
            self.scores[first, stop] = score
        return score

    def counts(self, first: int, stop: int) -> np.ndarray:
        """Return the counts of frames ``first <= t < stop``: uint32 (h, w), read-only.

        Raises BadInput if the window is empty or outside the recording.
        """
        window = validate_window(first, stop, total=self.frames)
        self.now = max(self.now, window.stop)
        return self.scorer.look(self._counts, first=window.start, stop=window.stop)


def _refuse_lens_command(what: str) -> BadInput:
    return BadInput(
        f"the lens of a recording cannot {what}",
        allowed="searches that estimate on a recording",
        hint="evaluate it with --track closed_loop",
    )
