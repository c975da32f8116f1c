"""What a method sees of a recording: its length, and the score of any window. The rest is the referee's."""

from collections.abc import Callable

from saf_gen.benchmark.view.metered_scorer import MeteredScorer
from saf_gen.benchmark.view.window_counts import WindowCounts
from saf_gen.core.region import validate_window
from saf_gen.errors import BadInput

__all__ = ["RecordingView"]


class RecordingView:
    """The handle on a recording that one method's search gets: see saf_gen.parts.View.

    ``frames_seen`` is the end of the latest window asked for. ``scorer`` is the method's, for the referee.
    """

    def __init__(self, counts: WindowCounts, measure: Callable[..., float]) -> None:
        self._counts, self.scorer = counts, MeteredScorer(measure)
        self.frames_seen = 0

    @property
    def windows(self) -> int:
        """Scores asked for."""
        return self.scorer.windows

    @property
    def seconds(self) -> float:
        """What the method computed: see :class:`MeteredScorer`."""
        return self.scorer.seconds

    @property
    def frames(self) -> int:
        """Frames in the recording."""
        return self._counts.frames

    @property
    def now(self) -> int:
        """The end of the latest window asked for."""
        return self.frames_seen

    @property
    def readout_hz(self) -> float:
        """Frames a second."""
        return self._counts.readout_hz

    @property
    def lag_s(self) -> float:
        """0: the positions of a recording are those of the lens."""
        return 0.0

    def position(self, frame: int) -> float:
        """Where the lens was, fraction of the travel; NaN where the stream does not say.

        Raises BadInput for a frame outside the recording.
        """
        window, lens = validate_window(frame, frame + 1, self.frames), self._counts.lens_position
        return float("nan") if lens is None else float(lens[window.start])

    def move(self, to: float) -> None:
        """Raises BadInput: what is recorded is recorded."""
        raise _recorded(f"be moved to {to:g}")

    def wait(self, frames: int) -> None:
        """Raises BadInput: every frame is there, and time does not pass."""
        raise _recorded(f"go on for {frames} frames")

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        """The score of frames ``first <= t < stop`` (0-based, at least one), by the measure or a named one.

        Raises BadInput for a window outside the recording, for a score that is no finite number, and for an
        unknown measure.
        """
        score = self.scorer.score(self._counts, first, stop, measure)
        self.frames_seen = max(self.frames_seen, int(stop))
        return score


def _recorded(what: str) -> BadInput:
    return BadInput(
        f"the lens of a recording cannot {what}",
        allowed="searches that estimate on a recording",
        hint="evaluate it with --track closed_loop",
    )
